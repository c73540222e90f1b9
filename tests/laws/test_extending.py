"""The page on laws, parameters, materials and networks of one's own: its code runs as it stands."""

import re
from pathlib import Path
from typing import Any

import pytest
import torch
from bodies import per_particle
from law_checks import deformations

from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
PAGE = Path(__file__).parents[2] / "docs" / "extending.md"


@pytest.mark.usefixtures("own_registry")
def test_every_block_of_the_page_runs() -> None:
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S)
    assert len(blocks) == 6
    names: dict[str, Any] = {}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)  # noqa: S102  # our own page
    assert names["motion"].position.shape == (3, 64, 3)
    assert torch.isfinite(names["slope"]).all()
    assert float(names["remembered"][0]) == 0.0, "a change of volume alone is no flow"
    assert abs(float(names["amplitude"].grad)) > 1e-3
    f = deformations(1, 0.05)
    count = f.shape[2]
    laws = build_neural_laws(MATERIALS["clay"], {"name": "stiffening", "width": 8})
    parameters = per_particle(MATERIALS["clay"].defaults, count)
    untrained = names["Clay"]()(f, parameters)
    torch.testing.assert_close(laws.elasticity.double()(f, parameters), untrained, rtol=1e-9, atol=1e-6)
    assert laws.elasticity.kernel is not None
