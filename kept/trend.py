import json, sys, numpy as np
for r in sys.argv[2:]:
    rows=[json.loads(l) for l in open(f"/root/wt/runs/{r}/metrics.jsonl")]
    b=float(sys.argv[1]); out={}
    keys=["rollout/velocity_error","rollout/yaw_rate_error","rollout/falls","train/approx_kl","train/learning_rate","train/std","train/value_loss","train/explained_variance","train/clip_fraction","reward/mechanical_power"]
    for x in rows: out.setdefault(int(x["steps"]//b),[]).append([x.get(k,np.nan) for k in keys])
    print(r,"  vel yaw falls kl lr std vloss ev clip power")
    for k,v in sorted(out.items()): print("  ",(k+1)*b/1e6, np.array2string(np.nanmean(v,axis=0),precision=4,suppress_small=True,max_line_width=200))
