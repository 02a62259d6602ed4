"""Whether there is what a training needs."""

from collections.abc import Sequence

from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.examples import ExampleSet, missing_classes
from pavetwin.training.trainer.augment import Member
from pavetwin.training.trainer.options import TrainingOptions


def check_labels(training: Sequence[Member], validation: Sequence[Member], options: TrainingOptions) -> None:
    """Raises:
    PaveTwinError: there are no images to train on or to validate with, or a class has no object.
    """
    for name, members in (("train", training), ("val", validation)):
        if not members:
            raise PaveTwinError(f"The datasets have no images in their split '{name}'; split them with both.")
    if not any(not each.is_ignored for _, example in validation for each in example.objects):
        raise PaveTwinError("The validation images have no labelled object, by which a network could be judged.")
    missing = missing_classes(example for _, example in training)
    if absent := [name for name in missing if name not in options.without_classes]:
        names = ", ".join(absent)
        raise PaveTwinError(
            f"No training image shows a labelled {names}; add a dataset that has some, or leave them out "
            f"(`without` '{','.join(absent)}')."
        )


def check_photographs(training: Sequence[Member], photographs: ExampleSet | None, options: TrainingOptions) -> None:
    """Raises:
    PaveTwinError: a setting needs photographs that are not given, or none needs those that are.
    """
    wanted = options.adaptations
    if wanted and photographs is None:
        raise PaveTwinError(f"`{wanted[0]}` needs photographs without labels; name their folder (`photographs`).")
    if not wanted and photographs is not None:
        raise PaveTwinError(
            "`photographs`: no setting uses them; give fourier, appearance or teacher_weight (`overrides`)."
        )
    changing = [name for name in wanted if name != "teacher_weight"]
    if changing and not any(example.is_synthetic for _, example in training):
        raise PaveTwinError(f"`{changing[0]}` changes synthetic images, and the datasets have none to train on.")
