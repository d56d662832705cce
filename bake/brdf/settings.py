"""What the user chooses of a BRDF's bake."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from ..envelope.viewers import MOST_EACH_WAY
from ..errors import check_choice, check_setting
from ..images.storage import TABLE_STORAGES, Storage
from ..reading import Reading
from ..rights import Rights
from ..sampling.half_vector_cells import SamplerLayout
from ..sampling.half_vector_warp import HalfVectorWarp
from ..sampling.inverse_tables import MOST_CELLS
from ..tables.grids.normal_vector_grid import MAX_RESOLUTION
from ..tables.grids.parameterization import PARAMETERIZATIONS, Parameterization
from ..tables.search.byte_limit import LEAST_BYTES, MOST_BYTES, resolution_for
from ..tables.search.grid_search import BASES, Basis
from ..tables.table import FILTERS, Filter
from .samplers import IsotropicLayout

AlphaChoice = Literal["error", "intensity"]
SplineFit = Literal["auto", "plain", "fitted"]
FILTER_CHOICES = ("auto", *FILTERS)
_MOST_VIEWERS = MOST_EACH_WAY // 2
_USUAL_READING = Reading()
_NO_RIGHTS = Rights()


@dataclass(frozen=True)
class BakeSettings:
    """Settings of a BRDF's bake.

    Parameters
    ----------
    resolution : samples per elevation, N of the N x N x 2N table in the normal-vector basis; one in the half-vector
        basis has as many bytes
    parameterization : of the table's axes, or "auto": of least error
    alpha : how the Bezier shape is chosen, "error", "intensity", or a given (alpha_theta, alpha_phi). The latter two
        are of the normal-vector basis: with them "auto" means a Bezier table in that basis
    storage : of the table's texels
    filter : that the material reconstructs with; "auto": see `bake.tables.filter_choice`
    spline : coefficients for filter "bspline": the samples themselves as in Mallett & Yuksel 2016, fitted >= 0, or
        whichever of the two has the smaller measured error (a peak between two samples is better left smooth)
    sampler : kind and sizes of the samplers: alias tables, or a warp of the unit square
    envelope : also fit native closures under the measurement, and bake what they leave, for modes "exact", "balanced"
    basis : "normal" (theta_o, theta_i, phi_delta), "half" (theta_d, theta_h, phi_d), or "auto": of least error
    reading : how what the file leaves open is read; of no matter to a formula
    rights : author, licence and source, which the bundle keeps
    table_bytes : the file of each table may take so many, with `envelope` also the residual's, and of a sheet those of
        every part: as many samples as fit, whatever the resolution; of storage "log" and isotropic sources
    viewers : nodes of an anisotropic envelope's weights in elevation, and in half a turn of the azimuth
    """

    resolution: int = 64
    parameterization: Parameterization | Literal["auto"] = "auto"
    alpha: AlphaChoice | tuple[float, float] = "error"
    storage: Storage = Storage.HALF
    filter: Filter | Literal["auto"] = "trilinear"
    spline: SplineFit = "auto"
    sampler: IsotropicLayout = field(default_factory=SamplerLayout)
    envelope: bool = True
    basis: Basis | Literal["auto"] = "auto"
    viewers: tuple[int, int] = (24, 8)
    reading: Reading = _USUAL_READING
    rights: Rights = _NO_RIGHTS
    table_bytes: int | None = None

    def __post_init__(self) -> None:
        check_setting(
            "resolution",
            4 <= self.resolution <= MAX_RESOLUTION,
            f"from 4 to {MAX_RESOLUTION}",
            self.resolution,
        )
        check_choice("basis", self.basis, (*BASES, "auto"))
        check_choice("parameterization", self.parameterization, (*PARAMETERIZATIONS, "auto"))
        check_choice("filter", self.filter, FILTER_CHOICES)
        check_choice("spline", self.spline, get_args(SplineFit))
        check_choice("storage", str(self.storage), TABLE_STORAGES)
        object.__setattr__(self, "storage", Storage(self.storage))
        if self.table_bytes is not None:
            check_setting("table_bytes", self.storage is Storage.LOG, "of storage log", f"storage {self.storage}")
            possible = LEAST_BYTES <= self.table_bytes <= MOST_BYTES
            check_setting("table_bytes", possible, f"from {LEAST_BYTES} to {MOST_BYTES}", self.table_bytes)
        if isinstance(self.sampler, HalfVectorWarp):
            cells = max(self.sampler.n_h, self.sampler.n_phi)
            check_setting("sampler", cells <= MOST_CELLS, f"of at most {MOST_CELLS} rows and columns", cells)
        if isinstance(self.alpha, str):
            check_choice("alpha", self.alpha, get_args(AlphaChoice))
        else:
            check_setting("alpha", all(0 <= a <= 1 for a in self.alpha), "two numbers in [0, 1]", self.alpha)
        few = len(self.viewers) == 2 and all(2 <= count <= _MOST_VIEWERS for count in self.viewers)
        check_setting("viewers", few, f"two numbers from 2 to {_MOST_VIEWERS}", self.viewers)
        if self.alpha != "error":
            check_setting(
                "alpha", self.basis != "half", "alpha error, or basis normal", f"{self.alpha} in the half basis"
            )

    @property
    def usual_resolution(self) -> int:
        """The resolution, or with `table_bytes` about that of a table of so many."""
        return self.resolution if self.table_bytes is None else resolution_for(self.table_bytes)

    @property
    def tries_spline(self) -> bool:
        """Whether a B-spline of an isotropic table is made, be it only to weigh it."""
        return tries_spline(self.filter, self.envelope)

    @property
    def bases(self) -> tuple[str, ...]:
        """Bases to choose from."""
        if self.basis == "auto":
            return BASES if self.alpha == "error" else ("normal",)
        return (self.basis,)

    @property
    def spacing(self) -> Parameterization | Literal["auto"]:
        """The parameterisation, or "auto" where it is to be chosen."""
        return "bezier" if self.parameterization == "auto" and self.alpha != "error" else self.parameterization


def tries_spline(filter: str, envelope: bool) -> bool:
    """See `BakeSettings.tries_spline`: "auto" weighs one where the table is read as a whole."""
    return filter == "bspline" or (filter == "auto" and not envelope)
