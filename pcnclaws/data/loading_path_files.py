"""Files of loading paths: CSV tables and HDF5 groups, told apart by their endings."""

from collections.abc import Sequence
from pathlib import Path

from pcnclaws.data.loading_path_groups import read_groups
from pcnclaws.data.loading_path_tables import read_table
from pcnclaws.data.loading_paths import LoadingPath
from pcnclaws.errors import UserError

HDF5_ENDINGS, TABLE_ENDINGS = (".h5", ".hdf5"), (".csv",)


def read_loading_paths(files: Sequence[Path], units: Sequence[tuple[str, str]] = ()) -> list[LoadingPath]:
    """The loading paths of CSV and HDF5 files. Those of CSV files are of one specimen.

    units   pairs of a pattern of names and the unit of stress of the paths of HDF5 files that do not say it
    raises  UserError for a missing, damaged or ambiguous file, and for two paths of one name
    """
    paths: list[LoadingPath] = []
    for file in files:
        ending = file.suffix.lower()
        if ending not in (*HDF5_ENDINGS, *TABLE_ENDINGS):
            raise UserError(f"data.stress={file} is not accepted; accepted: a file that ends in .csv, .h5 or .hdf5")
        if not file.is_file():
            raise UserError(f"data.stress={file}: no such file")
        paths += read_groups(file, units) if ending in HDF5_ENDINGS else [read_table(file)]
    names = [path.name for path in paths]
    if doubled := [name for name in names if names.count(name) > 1]:
        raise UserError(f"data.stress: two paths are called '{doubled[0]}'; accepted: one path of a name")
    return paths
