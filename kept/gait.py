"""gait.py ROBOT POLICY...: effort at steady 0.5 m/s, 4 validation episodes"""
import sys
from evaluate.measures.metrics import summarise
from evaluate.rollouts.hardware import Hardware
from evaluate.rollouts.rollout import run
from quad_env.seeding import episode_seeds
robot,*names=sys.argv[1:]
hw=Hardware(robot=robot); seeds=episode_seeds("validation",31,4)
for n in names:
    m=summarise(run(hw.policy(n),"steady",seeds=seeds,nthread=1,hardware=hw))
    print(n,{k:round(float(v),3) for k,v in m.items() if k in ("success_rate","cost_of_transport","step_rate","duty_factor","flight","trunk_height","velocity_error","yaw_rate_error","touchdown_impulse")},flush=True)
