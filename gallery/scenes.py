"""Which photographs show one place: neighbouring ones of a flight know each other's pavement."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pavetwin.training.datasets.duplicates import alike, signature
from pavetwin.training.datasets.overlaps import candidates, overlap


def scenes_of(pictures: Sequence[Path]) -> list[int]:
    """The number of each picture's scene: pictures that show one place, as a whole or in part, are of one scene, as in
    `pavetwin data merge`.

    Raises:
        PictureError: one of them cannot be read.
    """
    signatures = [signature(path) for path in pictures]
    features = [each.features for each in signatures]
    pairs = [(one, other) for one, other, _ in alike(np.array([each.thumbnail for each in signatures]))]
    pairs += [(one, other) for one, other in candidates(features) if overlap(features[one], features[other])]
    ones, others = np.array(pairs, dtype=int).reshape(-1, 2).T
    links = coo_matrix((np.ones(len(pairs)), (ones, others)), shape=(len(pictures), len(pictures)))
    return [int(each) for each in connected_components(links, directed=False)[1]]
