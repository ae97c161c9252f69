import json,sys
for r in sys.argv[1:]:
    rows=[json.loads(l) for l in open(f"/root/wt/runs/{r}/metrics.jsonl")]
    last={}
    for x in rows:
        for k,v in x.items():
            if k.startswith(("severity/","kept/")): last[k]=v
    print(r, rows[-1]["steps"]/1e6, {k[9:]:(round(v,2), round(last.get("kept/"+k[9:],-1),2)) for k,v in last.items() if k.startswith("severity/")})
    print({k:round(v,5) for k,v in rows[-2].items() if k.startswith(("reward","train"))})
