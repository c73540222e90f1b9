"""Tables whose cells the csv module gives up on are one line in every reader of them."""

from collections.abc import Callable
from pathlib import Path

import pytest

from pcnclaws.data.loading_path_files import read_loading_paths
from pcnclaws.data.marker_tables import read_table
from pcnclaws.data.point_frames import read_point_frames
from pcnclaws.errors import UserError

LONG = "1" * 200_000
READERS: dict[str, tuple[Callable[[Path], object], str]] = {
    "stress": (lambda path: read_loading_paths([path]), "lambda,P_kPa\n1,0\n"),
    "markers": (read_table, "time,marker,x,y,z\n0,a,0,0,0\n"),
    "points": (read_point_frames, "time,x,y,z\n0,0,0,0\n"),
}


@pytest.mark.parametrize("place", ["first line", "last line"])
@pytest.mark.parametrize("reader", list(READERS))
def test_a_cell_without_end_is_one_line(reader: str, place: str, tmp_path: Path) -> None:
    read, table = READERS[reader]
    (tmp_path / "t.csv").write_text(LONG + table if place == "first line" else table + LONG)
    with pytest.raises(UserError, match=r"t.csv: no table of comma-separated values, or damaged \(field larger"):
        read(tmp_path / "t.csv")


@pytest.mark.parametrize("reader", ["markers", "points"])
def test_a_table_that_is_not_there_is_one_line(reader: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="nowhere.csv: no such file"):
        READERS[reader][0](tmp_path / "nowhere.csv")
