"""Loading paths of CSV and HDF5 files: what they say, and one line for what they do not say."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from pcnclaws.data.loading_path_files import read_loading_paths
from pcnclaws.data.loading_paths import LoadingPath
from pcnclaws.errors import UserError

MEASURED = Path(__file__).parents[2] / "docs" / "measured"
UNITS = (("Budday_2017/*", "kPa"), ("Katashima_2012/*", "kPa"), ("*", "MPa"))


def _table(folder: Path, text: str) -> LoadingPath:
    file = folder / "path.csv"
    file.write_text(text, encoding="utf-8")
    return read_loading_paths([file])[0]


def _group(file: Path, attributes: dict[str, Any], **arrays: Any) -> Path:
    n = 3
    given = {"F": np.tile(np.eye(3), (n, 1, 1)), "stress": np.ones((n, 1, 1)) * np.diag([1.0, 0, 0])} | arrays
    with h5py.File(file, "w") as out:
        group = out.create_group("study/UT")
        group.attrs.update(attributes)
        for name, values in given.items():
            group[name] = values
    return file


def test_the_measured_foams_have_free_sides_and_stress_in_pascal() -> None:
    paths = read_loading_paths(sorted((MEASURED / "foam").glob("foam_leap_*.csv")))
    assert [path.name for path in paths] == ["foam_leap_UC", "foam_leap_UT"]
    for path in paths:
        assert path.free.tolist() == [False, True, True]
        assert (path.measured, path.is_cauchy, path.is_incompressible) == ([(0, 0)], False, False)
    assert (paths[0].deformation[0, 0, 0], paths[0].stress[0, 0, 0]) == (0.4, -241599.607)


def test_the_measured_rubbers_are_48_paths_of_8_studies() -> None:
    paths = read_loading_paths([MEASURED / "rubber" / "hyperelastic.h5"], UNITS)
    assert (len(paths), len({path.specimen for path in paths})) == (48, 8)
    assert all(path.is_incompressible for path in paths)
    known = {path.name: path for path in paths}
    assert known["Treloar_1944/UT"].free.tolist() == [False, True, True]
    assert np.nanmax(known["Treloar_1944/UT"].stress) == pytest.approx(6.318e6, rel=1e-3)
    assert known["Kawabata_1981/PS"].free.tolist() == [False, False, True]
    assert known["James_1975/BT_lambda_3d0"].measured == [(0, 0), (1, 1)]
    assert known["Budday_2017/SS_cortex"].measured == [(0, 1)]
    assert not known["Budday_2017/SS_cortex"].free.any()
    assert known["Jones_1975/BT_lambda_1"].is_cauchy


@pytest.mark.parametrize(
    ("text", "free", "measured", "is_cauchy"),
    [
        ("lambda,P_MPa\n1.1,2\n", [False, True, True], (0, 0), False),
        ("lambda_1,lambda_2,sigma_11_kPa\n1.1,1.0,2\n", [False, False, True], (0, 0), True),
        ("gamma,P_kPa\n0.1,2\n", [False, False, False], (0, 1), False),
        ("F11,F12,F22,F33,sigma12_Pa\n1,0.1,1,1,2\n", [False, False, False], (0, 1), True),
    ],
)
def test_columns_say_which_sides_are_free_and_which_stress_it_is(
    tmp_path: Path, text: str, free: list[bool], measured: tuple[int, int], is_cauchy: bool
) -> None:
    path = _table(tmp_path, text)
    assert (path.free.tolist(), path.measured, path.is_cauchy) == (free, [measured], is_cauchy)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("lambda,P\n1,2\n", "the column 'P' has no unit; accepted: P_Pa, P_kPa, P_MPa"),
        ("lambda,P_Mpa\n1,2\n", "unit of stress='Mpa' is not known; accepted: GPa, MPa, Pa, kPa; did you mean 'MPa'"),
        ("strain,P_MPa\n1,2\n", "the column 'strain' is not known; accepted: lambda or lambda_1..3"),
        ("lambda\n1\n", "no column holds a stress"),
        ("P_MPa\n1\n", "no column holds a deformation"),
        ("lambda,P_MPa,sigma_22_MPa\n1,2,3\n", "holds P and sigma; accepted: one kind of stress a file"),
        ("lambda,F11,P_MPa\n1,1,2\n", "the column 'F11' is there twice"),
        ("lambda,P_MPa\n1,x\n", "line 2: P_MPa=x is not a finite number"),
        ("lambda,P_MPa\n1\n", "line 2 has 1 cells; accepted: 2"),
        ("lambda,P_MPa\n", "holds no points"),
        ('"lambda\nP_MPa"\n', r"under 'lambda\nP_MPa'"),
        ('lambda,"x\ny"\n1,2\n', "is not known"),
        ("", "does not name its columns"),
        ("lambda,P_MPa\n-1,2\n", "point 0 has det F <= 0"),
        ("lambda,P_MPa\n1.1,0\n", "holds no stress but zeros"),
        ("lambda,P22_MPa\n1.1,2\n", "side 2 is free and its stress is given"),
    ],
)
def test_what_a_table_does_not_say_is_asked_for_in_one_line(tmp_path: Path, text: str, fault: str) -> None:
    with pytest.raises(UserError) as raised:
        _table(tmp_path, text)
    assert fault in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("attributes", "arrays", "fault"),
    [
        ({"unit": "MPa"}, {}, "@stress_type is missing"),
        ({"stress_type": "PK2", "unit": "MPa"}, {}, "stress_type='PK2' is not known; accepted: PK1, cauchy"),
        ({"stress_type": "PK1"}, {}, "no @unit of the stress"),
        ({"stress_type": "PK1", "unit": "bar"}, {}, "unit of stress='bar' is not known"),
        ({"stress_type": "PK1", "unit": "MPa"}, {"F": np.ones((3, 2, 2))}, "'F' has the shape (3, 2, 2)"),
        ({"stress_type": "PK1", "unit": "MPa"}, {"stress": np.full((3, 3, 3), np.nan)}, "not finite"),
    ],
)
def test_a_damaged_group_is_one_line(
    tmp_path: Path, attributes: dict[str, Any], arrays: dict[str, Any], fault: str
) -> None:
    with pytest.raises(UserError) as raised:
        read_loading_paths([_group(tmp_path / "x.h5", attributes, **arrays)])
    assert fault in str(raised.value)


def test_files_of_other_kinds_and_doubled_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such file"):
        read_loading_paths([tmp_path / "none.csv"])
    with pytest.raises(UserError, match=r"accepted: a file that ends in \.csv, \.h5 or \.hdf5"):
        read_loading_paths([tmp_path / "paths.xlsx"])
    table = tmp_path / "path.csv"
    table.write_text("lambda,P_MPa\n1.1,2\n")
    with pytest.raises(UserError, match="two paths are called 'path'"):
        read_loading_paths([table, table])
