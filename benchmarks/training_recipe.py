"""The recipe of `python -m benchmarks.full_training`."""

from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from pavetwin.config.settings import PlacedValueError, Settings
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.training.datasets.recipe import recipe_values
from pavetwin.training.trainer.options import TrainingOptions

OF_RUN = ("size", "seed")
"""Settings that the recipe gives each run."""


class Training(Settings):
    """What is trained on, and how."""

    datasets: tuple[str, ...] = Field(min_length=1, description="Names of datasets.")
    start: str | None = Field(
        default=None, description="An earlier training, a file beside the recipe, or a detector that ships."
    )
    settings: dict[str, Any] = Field(default={}, description="Laid over those of the recipe.")
    licence: str = Field(default="", description="Of the weights, as the exported file says it.")


class Variants(Settings):
    """The comparison of networks and orders of training (`python -m benchmarks.training`)."""

    synthetic: str
    photographs: str
    views: int = Field(default=15_000, ge=1, description="Of each run.")


class TrainingRecipe(Settings):
    """Datasets, trainings, sizes and seeds."""

    datasets: dict[str, Path] = Field(
        min_length=1, description="A recipe of `pavetwin data build` or a folder, beside the recipe, by name."
    )
    settings: dict[str, Any] = Field(default={}, description="Of all trainings, as `pavetwin train --set` takes them.")
    sizes: tuple[Literal["n", "s", "m", "l"], ...] = Field(default=("n",), min_length=1)
    seeds: int = Field(default=3, ge=1, description="Runs of each training.")
    trainings: dict[str, Training] = Field(
        min_length=1,
        description="By name, in order; without models beside them, the first is what the others are compared with.",
    )
    beside: tuple[str, ...] = Field(
        default=(), description="Models that the trainings are compared with: what ships, by name, or exported files."
    )
    variants: Variants | None = None

    @field_validator("settings")
    @classmethod
    def _has_its_own_runs(cls, settings: dict[str, Any]) -> dict[str, Any]:
        if given := [name for name in OF_RUN if name in settings]:
            raise ValueError(f"{given[0]} is given by sizes and seeds")
        return settings

    @model_validator(mode="after")
    def _checked(self) -> Self:
        """Everything that can be known before hours of work is refused now."""
        before: list[str] = []
        for name, each in self.trainings.items():
            for at, data in enumerate(each.datasets):
                if data not in self.datasets:
                    told = no_such("dataset", data, self.datasets, key="`dataset`")
                    raise PlacedValueError(("trainings", name, "datasets", at), told.rstrip("."))
            if each.start in self.trainings and each.start not in before:
                raise PlacedValueError(("trainings", name, "start"), f"'{each.start}' comes later in the recipe")
            before.append(name)
        for which in ("synthetic", "photographs"):
            if self.variants is not None and getattr(self.variants, which) not in self.datasets:
                told = no_such("dataset", getattr(self.variants, which), self.datasets, key="`dataset`")
                raise PlacedValueError(("variants", which), told.rstrip("."))
        return self

    def options(self, name: str, size: str, seed: int) -> TrainingOptions:
        """Of a run.

        Raises:
            PaveTwinError: a setting is not known, or a value is not what it takes.
        """
        return TrainingOptions.parse({**self.settings, **self.trainings[name].settings, "size": size, "seed": seed})

    @classmethod
    def read(cls, path: Path) -> Self:
        """Of a file.

        Raises:
            PaveTwinError: it cannot be read, or a key or value does not fit.
        """
        where = f"the recipe '{path}'"
        values, text = recipe_values(path)
        recipe = cls.parse(values, where, text)
        for name in recipe.trainings:
            try:
                recipe.options(name, recipe.sizes[0], 0)
            except (PaveTwinError, TypeError) as error:
                raise PaveTwinError(f"{where}, trainings.{name}: {error}") from error
        return recipe
