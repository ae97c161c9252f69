"""dagger.py OUT ROBOT TEACHER LABELS[k] ROBOTS -- extra train options. Imitation of a scripted controller by DAgger."""
import sys, time, json
from dataclasses import replace
import numpy as np, torch
from torch import nn
from train.commands.run import parse
from train.run import make_env
from train.residual_env import ResidualVectorEnv, BaseOf
from train.training_robots import make_robots, bases_of, robots_per_scenario, _real, training_seeds
from train.run_record import to_dict
from policies.history import Inputs
from policies.residual import ResidualPolicy, authority_of
from policies.network import Network
from policies.bundle import save as save_bundle
out, robot, teacher_name, labels, robots = sys.argv[1:6]
extra = sys.argv[6:]
labels = int(float(labels)*1000)
words = f"--robot {robot} --ppo.envs {robots} --threads 1 --out {out}".split() + extra
config = parse(words)
hold = config.ppo.hold
class Env(ResidualVectorEnv):
    def __init__(self, env, bases, teachers, *a):
        super().__init__(env, bases, *a)
        rows = [b.rows for b in self.bases]
        self.teachers = [BaseOf(t, r, Inputs()) for t, r in zip(teachers, rows, strict=True)]
    def reset(self, **k):
        for t in self.teachers: t.reset()
        return super().reset(**k)
    def _tick(self, obs):
        super()._tick(obs)
        for t in self.teachers: t.tick(obs)
    def _restart(self, finished, infos):
        fresh = self.env.reset
        keep = {}
        def spy(**k):
            r = fresh(**k); keep["obs"] = r[0]; return r
        self.env.reset = spy
        try: infos = super()._restart(finished, infos)
        finally: del self.env.reset
        for t in self.teachers: t.begin(finished, keep["obs"])
        return infos
    @property
    def label(self):
        base = np.concatenate([b.action for b in self.bases]); t = np.concatenate([b.action for b in self.teachers])
        return (t - base) / self.authority
rob = make_robots(config)
bases = bases_of(config)
made = lambda real: config.hardware.policy(teacher_name, **({"real": True, "robot": bases[0][0].robot} if real else {}))
counts=[0,0]
for name, c in robots_per_scenario(config).items(): counts[_real(config,name)] += c
teachers = [made(bool(r)) for r,c in enumerate(counts) if c]
print("gains", bases[0][0].robot.joint_kp if hasattr(bases[0][0].robot,"joint_kp") else "", flush=True)
authority = authority_of(rob.robot, config.hip_authority, config.joint_authority)
env = Env(rob, bases, teachers, authority, hold, config.inputs)
torch.set_num_threads(1)
seg = max(1, config.max_episode_steps // hold)
width = env.single_observation_space.shape[0]
layers, sizes = [], [width, *config.ppo.actor, 12]
for a, b in zip(sizes[:-1], sizes[1:]): layers += [nn.Linear(a, b), nn.ELU()]
net = nn.Sequential(*layers[:-1]); opt = torch.optim.Adam(net.parameters(), 1e-3)
X, Y = np.zeros((labels + 10**5, width), np.float32), np.zeros((labels + 10**5, 12), np.float32); n = 0
def fit(passes, rate):
    for g in opt.param_groups: g["lr"] = rate
    losses=[]
    for _ in range(passes):
        for i in range(0, n, 4096):
            idx = np.random.randint(0, n, 4096)
            x, y = torch.from_numpy(X[idx]), torch.from_numpy(Y[idx])
            loss = nn.functional.smooth_l1_loss(net(x), y, beta=0.1); opt.zero_grad(); loss.backward(); opt.step(); losses.append(loss.item())
    return np.mean(losses[-50:])
def save():
    lin = [l for l in net if isinstance(l, nn.Linear)]
    arr = lambda t: np.ascontiguousarray(t.detach().numpy().astype(np.float32, copy=True))
    network = Network(tuple(arr(l.weight.T) for l in lin), tuple(arr(l.bias) for l in lin))
    import copy
    p = ResidualPolicy(copy.deepcopy(bases[0][0]), network, authority, config.policy, config.inputs, hold)
    save_bundle(config.out, p, to_dict(config), "experiment")
t0 = time.time(); segment = 0; obs = None; step = 0; rng = np.random.default_rng(0)
while n < labels:
    if step % seg == 0:
        obs, _ = env.reset(seed=training_seeds(config, segment)); segment += 1
    y = np.clip(env.label, -1, 1)
    if n + len(obs) > len(X): break
    X[n:n+len(obs)], Y[n:n+len(obs)] = obs, y; n += len(obs)
    # a share of the robots follows the teacher, the rest the student
    beta = max(0.0, 1.0 - step / (0.5 * seg)) if segment == 1 else 0.1
    with torch.no_grad(): a = net(torch.from_numpy(obs)).numpy()
    who = (np.arange(len(obs)) * 0.6180339) % 1.0 < beta
    a = np.where(who[:, None], y, a + rng.normal(0, 0.03, a.shape)).astype(np.float32)
    obs, *_ = env.step(np.clip(a, -1, 1)); step += 1
    if step % 10 == 0:
        loss = fit(2 if n < 300_000 else 1, 1e-3)
    if step % 50 == 0:
        print("label std", Y[:n].std(0).round(3), "mean abs", np.abs(Y[:n]).mean().round(4))
        s = rob.take_statistics()
        print(f"{n} labels {time.time()-t0:.0f} s beta {beta:.2f} loss {loss:.5f} v {s['velocity_error']:.3f} yaw {s['yaw_rate_error']:.3f} episodes {s['episodes']:.0f} falls {s['falls']:.2f} clipped {(abs(y)>=1).mean():.3f}", flush=True)
for r in (1e-3, 5e-4, 2e-4, 1e-4): print("final", r, fit(2, r), flush=True); 
save(); print("saved", time.time()-t0)
