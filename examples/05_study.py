"""A small study: two policies in eight replicates over one crossing, its table, and what it recommends."""

import sys
from pathlib import Path

import polars as pl

import pavetwin as pt
from pavetwin.experiments.design import read_design
from pavetwin.experiments.engine import Single
from pavetwin.experiments.run import run
from pavetwin.experiments.statistics import MissionLimits, recommend

DESIGN = """
name: crossroads
worlds: [crossroads]
densities: [medium]
altitudes_m: [6, 10]
policies: [baseline, hover]
replicates: 8
defects: {per_segment: 10}
"""

if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/study_example")
    pt.save_world(pt.build_world(Path(__file__).parent / "crossroads.osm"), folder / "crossroads", force=True)
    design = folder / "study.yaml"
    design.write_text(DESIGN, encoding="utf-8")
    study = run(read_design(design), folder / "study", Single())  # killed at any moment, it resumes
    print(study.table.group_by("altitude_m", "policy").agg(pl.mean("coverage", "time_s")).sort("altitude_m", "policy"))
    print(*recommend(study.table, MissionLimits(max_time_s=120)).sentences, sep="\n")
