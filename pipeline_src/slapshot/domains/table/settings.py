"""Settings of the block `scene` of the domain `table`."""

import math
from typing import Annotated

from pydantic import Field, model_validator

from slapshot.config.scene import Coordinate, Extent, SceneSettings, Timestep

# Bounds of density: an object lighter than air floats, and no material is denser than osmium.
AIR, OSMIUM = 1.2, 22600.0  # kg/m^3

# Sizes that one can put on a table, strike and track: from a grain of a millimetre to a crate.
Edge = Annotated[float, Field(ge=0.001, le=2, description="m")]
Mass = Annotated[float, Field(ge=1e-6, le=1000, description="kg")]


class TableScene(SceneSettings):
    """A box on a table."""

    size_m: tuple[Edge, Edge, Edge] = Field(
        description="edge lengths in m along x and y before the hit, and height in m"
    )
    mass_kg: Mass
    timestep_s: Timestep
    start_m: tuple[Coordinate, Coordinate] = Field(description="x, y in m of the box before a hit")
    table_m: tuple[Extent, Extent] = Field(description="extent in m along x and y of the visible table")

    @model_validator(mode="after")
    def _box_of_matter(self) -> "TableScene":
        density = self.mass_kg / math.prod(self.size_m)
        if not AIR <= density <= OSMIUM:
            wrong = "lighter than air" if density < AIR else "denser than any metal"
            raise ValueError(
                f"mass_kg {self.mass_kg:g} in size_m {list(self.size_m)} is {wrong} ({density:.3g} kg/m^3); "
                "correct the mass or the size"
            )
        return self
