"""PC-NCLaws-M: many scenes of one material."""

from collections.abc import Sequence

from pcnclaws.errors import UserError
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.module import ConstitutiveModule


class MultiSceneModule(ConstitutiveModule):
    """Learns a whole material (the paper's PC-NCLaws-M) from objects of different physical parameters."""

    @staticmethod
    def choose_scenes(records: Sequence[SceneRecord], scene: str | int | None) -> list[SceneRecord]:
        """Every scene."""
        if scene is not None:
            raise UserError(
                f"regime.scene={scene} is not accepted with regime=multi_scene; accepted: null, or regime=single_scene"
            )
        return list(records)
