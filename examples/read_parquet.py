"""Episodes of an evaluation as a table: `python examples/read_parquet.py results/evaluation`.

`python -m evaluate --out FOLDER` writes the folder; `env.reset(seed=row.seed)` repeats a row's episode.
"""

from pathlib import Path

import pyarrow.compute as pc
import pyarrow.parquet as pq
import tyro


def main(folder: tyro.conf.Positional[Path] = Path("results/evaluation")) -> None:
    """Print outcomes and errors by policy and scenario, and the first falls.

    Args:
        folder: Folder of the evaluation.
    """
    episodes = pq.read_table(folder / "episodes.parquet")
    succeeded = pc.equal(episodes["outcome"], "succeeded").cast("int8")
    groups = episodes.append_column("succeeded", succeeded).group_by(["policy", "scenario"])
    means = groups.aggregate([("succeeded", "mean"), ("velocity_error", "mean"), ("seed", "count")])
    for row in means.to_pylist():
        outcome = f"{row['succeeded_mean']:4.0%} of {row['seed_count']}, {row['velocity_error_mean']:.3f} m/s off"
        print(f"{row['policy']:24} {row['scenario']:16} {outcome}")
    fallen = episodes.filter(episodes["fell"]).sort_by("fall_time").select(["policy", "scenario", "seed", "fall_time"])
    for row in fallen.slice(0, 5).to_pylist():
        print(f"{row['policy']} fell on {row['scenario']} after {row['fall_time']:.2f} s, seed {row['seed']}")


if __name__ == "__main__":
    tyro.cli(main)
