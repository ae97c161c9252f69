"""val.py ROBOT EPISODES SEED THREADS POLICY... : validation episodes of another seed, 24 scenarios of training."""
import sys, os, json
from functools import partial
from evaluate.measures.metrics import summarise
from evaluate.rollouts.hardware import Hardware
from evaluate.rollouts.rollout import run
from quad_env.seeding import episode_seeds
from train.curriculum import practice
robot, episodes, seed, threads, *names = sys.argv[1:]
S = os.environ.get("SCEN", "flat:2 flat:4 push:3 push:2+hardware rough:3 rough:2+hardware stairs:3 gravel:3 soft:4 slope:4 slope:3+hardware slippery:4 latency:2 latency:4 noise:4 dropout:4 payload:4 payload:3+hardware force:3 force:2+hardware slow_motors:4 weak_motors:4 surprise:3 flat:2+hardware").split()
hw = Hardware(robot=robot)
seeds = episode_seeds("validation", int(seed), int(episodes))
out = {}
for n in names:
    out[n] = {}
    for s in S:
        sc = practice(s, "validation", robot=hw.quadruped)
        p = hw.policy(n, real=sc.hardware)
        out[n][s] = summarise(run(p, sc, seeds=seeds, nthread=int(threads), hardware=hw))
    r = out[n]
    print(n, "success", round(100*sum(x["success_rate"] for x in r.values())/len(r), 1), "cost", {s: round(r[s]["cost_of_transport"], 2) for s in list(r)[:2]}, flush=True)
    print("   ", " ".join(f'{s} {100*x["success_rate"]:.0f}' for s, x in r.items()), flush=True)
