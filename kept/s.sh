#!/bin/bash
# s.sh WORKTREE ROBOT OUT STEPS extra...: sighted residual on mpc_wbc_sighted
W=$1; R=$2; O=$3; N=$4; shift 4
cd /root/wt/$W
OMP_NUM_THREADS=1 exec /work/main/.venv/bin/python -m train --robot $R --base mpc_wbc_sighted --out /root/wt/runs/$O --steps $N --threads 1 --seed 0 --curriculum 0.5 --effort-ramp 0 --joint-authority 0.6 --hip-authority 0.4 --mixture flat:2 0.03 flat:4 0.04 push:3 0.05 rough=0.2 0.08 rough=0.24 0.08 stairs=0.15 0.22 stairs=0.1 0.08 gravel:4 0.12 gravel:3 0.08 soft=0.04 0.12 rough=0.2+scan_lost 0.05 stairs=0.1+scan_lost 0.05 --ppo.envs 512 --ppo.rollout-steps 24 --ppo.minibatch 4096 --ppo.learning-rate 3e-4 --ppo.target-kl 0.012 --ppo.log-std-init -3.0 --ppo.actor 256 256 --ppo.critic 256 256 --rewards.mechanical-power -0.001 --rewards.fall -2 --rewards.action-rate -0.05 --rewards.crouch -3 --validation.interval 0 --validation.episodes 6 "$@"
