"""A recorded motion that a command is given, with the law that its stress is of."""

from pathlib import Path

from pcnclaws.commands.runs import laws_for
from pcnclaws.data.hdf5 import scene_names
from pcnclaws.data.trajectory_files import READERS, read_trajectories
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.simulation.particle_fields import ParticleFields
from pcnclaws.simulation.records import SceneRecord


def recorded_scene(path: object, name: str | None, option: str, with_keyframes: bool = True) -> SceneRecord:
    """The scene of a trajectory file, the only one or that of `scene=`.

    option  that names the file
    raises  UserError
    """
    if not isinstance(path, str) or not path:
        raise UserError(f"{option}={path or 'null'} is not accepted; accepted: the path of a trajectory file")
    if Path(path).suffix.lower() in READERS:
        return read_trajectories(path, "", [name] if name else None)[0]
    known = scene_names(path)
    if name is None and len(known) > 1:
        raise UserError(f"{path}: holds {len(known)} scenes; accepted: scene= one of {', '.join(known[:20])}")
    return read_trajectories(path, "", [name or known[0]], with_keyframes)[0]


def fields_of(record: SceneRecord, law: str) -> ParticleFields:
    """The fields of a recorded motion, with the stress of the law that `law=` names.

    raises  UserError for a law that is not there, or of another material
    """
    if record.states_at_frames is None:
        return ParticleFields(record)
    if record.material not in MATERIALS:
        return ParticleFields(record, why=f"no law of the material '{record.material}' is known")
    material = MATERIALS[record.material]
    unknown = [name for name in material.parameter_names if name not in record.parameters]
    if unknown:
        return ParticleFields(record, why=f"the file does not say {', '.join(unknown)}")
    return ParticleFields(record, laws_for(law, material, [record.parameters]))
