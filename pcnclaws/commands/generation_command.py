"""Generation of a data set and of its picture."""

from pathlib import Path

from pcnclaws.commands.configuration import use_processor
from pcnclaws.commands.data_sets import ready_data_set
from pcnclaws.commands.typed_configs import GenerateConfig
from pcnclaws.data.generation import read_split
from pcnclaws.rendering.contact_sheet import contact_sheet

PICTURE = "data_set.png"


def generate(config: GenerateConfig) -> None:
    """Makes what is missing of the data set in data.folder, and a picture of it."""
    use_processor(config)
    files = ready_data_set(config)
    folder = Path(config.data.folder)
    for split, paths in files.items():
        size = sum(path.stat().st_size for path in paths) / 1024**2
        print(f"{split}: {len(paths)} scenes of {config.material.name}, {size:.1f} MiB, in {folder / split}")
    records = [record for split in files for record in read_split(folder, split)]
    print(f"wrote {contact_sheet(records, folder / PICTURE)}")
