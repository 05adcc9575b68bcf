"""One table of all evaluations: a row for each scene and painting, and one for each scene's mean."""

import json
from pathlib import Path

COLUMNS = [
    "texture_own_painting_nearest",
    "texture_rank",
    "own_painting_nearest",
    "style_error",
    "content_error",
    "grain",
]


def row(scene, painting, of):
    baked, recolored = of["stylized"], of["recolored"]
    values = [baked[column] for column in COLUMNS] + [baked["style_error"] / recolored["style_error"]]
    return "\t".join([scene, painting, *(f"{value:.4f}" for value in values)])


lines = ["\t".join(["scene", "painting", *COLUMNS, "style_error_over_recolored"])]
for path in snakemake.input:
    evaluation, scene = json.loads(Path(path).read_text()), Path(path).parent.name
    lines += [row(scene, Path(of["path"]).stem, of) for of in evaluation["paintings"]]
    lines.append(row(scene, "mean", evaluation))
Path(snakemake.output[0]).write_text("\n".join(lines) + "\n")
