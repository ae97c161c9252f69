"""The checks, in the order in which one thing rests on another."""

from quad_env.doctor.check import Check

HERE = "quad_env.doctor"
OF_THE_INSTALLATION = (
    Check("python", f"{HERE}.packages:python"),
    Check("packages", f"{HERE}.packages:packages"),
    Check("extras", f"{HERE}.packages:extras"),
    Check("folder", f"{HERE}.folder:folder"),
    Check("mujoco", f"{HERE}.packages:mujoco", ("packages",)),
    Check("opengl", f"{HERE}.drawing:opengl", ("mujoco",)),
)
OF_THE_ROBOT = (
    Check("model", f"{HERE}.model:model", ("mujoco",)),
    Check("limits", f"{HERE}.joints:limits", ("model",)),
    Check("period", f"{HERE}.motion:period", ("model",)),
    Check("joints", f"{HERE}.joints:joints", ("limits", "period")),
    Check("ground", f"{HERE}.model:ground", ("model",)),
    Check("batch", f"{HERE}.motion:batch", ("period",)),
    Check("servos", f"{HERE}.motion:servos", ("joints", "ground")),
    Check("plausible", f"{HERE}.model:plausible", ("servos",)),
    Check("stands", f"{HERE}.motion:stands", ("servos",)),
    Check("speed", f"{HERE}.motion:speed", ("period",)),
)
