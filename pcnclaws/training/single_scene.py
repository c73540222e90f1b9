"""PC-NCLaws-S: one scene."""

from collections.abc import Sequence

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.module import ConstitutiveModule


class SingleSceneModule(ConstitutiveModule):
    """Learns the motion of one object (the paper's PC-NCLaws-S): its parameters never vary."""

    @staticmethod
    def choose_scenes(records: Sequence[SceneRecord], scene: str | int | None) -> list[SceneRecord]:
        """The scene of that name or number, the first one by default."""
        if scene is None or isinstance(scene, int):
            number = scene or 0
            if not 0 <= number < len(records):
                raise UserError(f"regime.scene={scene} is out of range; accepted: 0 to {len(records) - 1}, or a name")
            return [records[number]]
        chosen = [record for record in records if record.name == scene]
        if not chosen:
            raise unknown_name("regime.scene", scene, [record.name for record in records])
        return chosen[:1]
