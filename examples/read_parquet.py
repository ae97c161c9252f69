"""Every episode of an evaluation as a table: `python examples/read_parquet.py results/evaluation`.

The folder is what `python -m evaluate --out FOLDER` leaves; `env.reset(seed=row.seed)` begins a row's episode again.
"""

from pathlib import Path

import pyarrow.compute as pc
import pyarrow.parquet as pq
import tyro


def main(folder: tyro.conf.Positional[Path] = Path("results/evaluation")) -> None:
    """Outcomes and errors by policy and scenario, and the episodes that fell first."""
    episodes = pq.read_table(folder / "episodes.parquet")
    succeeded = pc.equal(episodes["outcome"], "succeeded").cast("int8")
    groups = episodes.append_column("succeeded", succeeded).group_by(["policy", "scenario"])
    of_groups = groups.aggregate([("succeeded", "mean"), ("velocity_error", "mean"), ("seed", "count")])
    for row in of_groups.to_pylist():
        share, error = row["succeeded_mean"], row["velocity_error_mean"]
        print(f"{row['policy']:24} {row['scenario']:16} {share:4.0%} of {row['seed_count']}, {error:.3f} m/s off")
    fallen = episodes.filter(episodes["fell"]).sort_by("fall_time").select(["policy", "scenario", "seed", "fall_time"])
    for row in fallen.slice(0, 5).to_pylist():
        print(f"{row['policy']} fell on {row['scenario']} after {row['fall_time']:.2f} s, seed {row['seed']}")


if __name__ == "__main__":
    tyro.cli(main)
