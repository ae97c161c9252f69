#!/bin/bash
# s.sh WORKTREE ROBOT OUT STEPS extra...: sighted residual on trot_reference
W=$1; R=$2; O=$3; N=$4; shift 4
cd /root/wt/$W
OMP_NUM_THREADS=1 exec /work/main/.venv/bin/python -m train --robot $R --base trot_reference --out /root/wt/runs/$O --steps $N --threads 1 --seed 0 --curriculum 0.1 --effort-ramp 0.25 --joint-authority 1.0 --hip-authority 0.6 --sighted --mixture flat:2 0.05 flat:4 0.05 push:3 0.08 rough=0.2 0.10 rough=0.24 0.10 stairs=0.15 0.18 stairs=0.1 0.06 gravel:4 0.12 gravel:3 0.06 soft=0.04 0.10 rough=0.2+scan_lost 0.05 stairs=0.1+scan_lost 0.05 --ppo.envs 2048 --ppo.rollout-steps 12 --ppo.minibatch 8192 --ppo.learning-rate-schedule adaptive --ppo.target-kl 0.012 --ppo.log-std-init -2.0 --rewards.mechanical-power -0.0015 --rewards.fall -5 --rewards.action-rate -0.05 --rewards.crouch -3 --validation.interval 5000000 --validation.episodes 6 "$@"
