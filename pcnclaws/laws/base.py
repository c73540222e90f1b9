"""The interfaces of elastic and of plastic laws: what a law of one's own states."""

from collections.abc import Mapping
from typing import Any, ClassVar

from jaxtyping import Float
from torch import Tensor

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.laws import principal
from pcnclaws.laws.formulas import TIME_STEP, Values, gradient
from pcnclaws.laws.law import Law
from pcnclaws.tensors.tensor_types import Matrices, Parameters


class Elasticity(Law):
    """Elastic law: deformation gradient to Kirchhoff stress.

    A law states its principal stress, or its energy, or (without a kernel) kirchhoff_stress itself. It may read
    internal variables; a plastic law changes them.
    """

    returns_strain = False

    def principal_stress(self, h: Values, p: Any) -> Values:
        """Principal Kirchhoff stresses [Pa] of principal Hencky strains h: the derivatives of the energy.

        p  the coefficients, and internal variables, by name
        """
        return gradient(lambda strains: self.principal_energy(strains, p), h)

    def principal_energy(self, h: Values, p: Any) -> Any:
        """Energy per initial volume [J/m^3] of principal Hencky strains h."""
        raise NotImplementedError(
            f"the law {type(self).__name__} states no energy; accepted: principal_energy, or else principal_stress or "
            "kirchhoff_stress"
        )

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau = P F^T [Pa], (3, 3, particles), symmetric.

        deformation  elastic deformation gradient F [-], (3, 3, particles), det F > 0
        parameters   physical parameters, and internal variables, by name, each (particles,)
        """
        return principal.stress(deformation, self.response(parameters))

    def energy_density(self, deformation: Matrices, parameters: Parameters) -> Float[Tensor, " particles"]:
        """Energy per initial volume [J/m^3], (particles,).

        raises  NotImplementedError for a law that states none
        """
        strains = principal.strains(deformation)
        return self.principal_energy(strains.unbind(0), self._formula_inputs(parameters)).to(deformation.dtype)

    @property
    def has_energy(self) -> bool:
        """Whether the law states its energy."""
        return type(self).principal_energy is not Elasticity.principal_energy

    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        return self.principal_stress(h, p)

    @property
    def is_principal(self) -> bool:
        return type(self).kirchhoff_stress is Elasticity.kirchhoff_stress

    def evaluate(self, deformation: Matrices, known: Parameters) -> tuple[Matrices, Mapping[str, Tensor]]:
        return self.kirchhoff_stress(deformation, known), {}


class Plasticity(Law):
    """Plastic law: trial deformation gradient and internal variables to those after plastic flow.

    A law states the strain after plastic flow, or with internal variables the flow, or (without a kernel) return_map
    itself.

    reads_time_step  formulas read p.time_step [s], and `coefficients` parameters["time_step"]: plastic flow takes time
    """

    returns_strain = True
    reads_time_step: ClassVar[bool] = False

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        read = super().coefficients(parameters)
        return {**read, TIME_STEP: parameters[TIME_STEP]} if self.reads_time_step else read

    def strain_after_flow(self, h: Values, p: Any) -> Values:
        """Principal Hencky strains after plastic flow [-] from those of the trial deformation, h.

        p  the coefficients, by name
        """
        raise NotImplementedError(f"{type(self).__name__} states no strain after plastic flow")

    def flow(self, h: Values, p: Any) -> tuple[Values, Mapping[str, Any]]:
        """Principal Hencky strains after plastic flow [-], and the internal variables that have changed, by name.

        p  the coefficients and the internal variables before it, by name
        """
        return self.strain_after_flow(h, p), {}

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after plastic flow [-], (3, 3, particles).

        trial       trial deformation gradient [-], (3, 3, particles), det > 0
        parameters  physical parameters, and internal variables, by name, each (particles,)
        """
        return self.evaluate(trial, parameters)[0]

    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        """Three strains after plastic flow, then the internal variables after it."""
        given = self.flow(h, p)
        if not isinstance(given, tuple) or len(given) != 2:
            raise UserError(
                f"the law {type(self).__name__}: flow gives {type(given).__name__}; accepted: three strains, and the "
                "internal variables by name"
            )
        strains, changed = given
        known = [variable.name for variable in self.internal_variables]
        for name in changed:
            if name not in known:
                raise unknown_name(f"the law {type(self).__name__}: internal variable", name, known)
        if type(self).flow is not Plasticity.flow and (missing := [name for name in known if name not in changed]):
            raise UserError(f"the law {type(self).__name__}: flow gives no {missing[0]}; accepted: {', '.join(known)}")
        return [*strains, *(changed.get(name, getattr(p, name)) for name in known)]

    @property
    def is_principal(self) -> bool:
        return type(self).return_map is Plasticity.return_map and type(self).evaluate is Plasticity.evaluate

    def evaluate(self, deformation: Matrices, known: Parameters) -> tuple[Matrices, Mapping[str, Tensor]]:
        """For a law of F with internal variables to say otherwise; one without says return_map."""
        if type(self).return_map is not Plasticity.return_map:
            return self.return_map(deformation, known), {}
        result, after = principal.elastic_deformation(deformation, self.response(known))
        names = [variable.name for variable in self.internal_variables]
        return result, dict(zip(names, after.to(deformation.dtype).unbind(0), strict=True))
