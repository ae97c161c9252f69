#!/bin/bash
# land.sh ROBOT: publish the run and evaluate the robot's policies, one process
r=$1; cd /root/wt/learn16; export OMP_NUM_THREADS=1 PYTHONPATH=$PWD; P=/work/main/.venv/bin/python
$P -m research publish /root/wt/runs/${r}_f --to models/$r/residual --episodes 32 --threads 1 --out /root/wt/results/publish_$r || exit 1
$P -m evaluate --robot $r --policies trot trot_feedback trot_reference mpc_wbc residual --episodes 12 --threads 1 --out results/$r
