"""Where hands may be in a depth image: the nearest thing, and the ends of everything that is seen.

The image becomes a graph: one node for every few pixels, edges between neighbours whose depths differ little. Its
components are things: a person, a table, a bottle, a hand held far from its body. A hand is at the end of something,
so each thing's ends are candidates: the node that is farthest from its middle along the surface, then the node that is
farthest from the middle and that end, and so on (accumulative geodesic extrema: Plagemann et al., 2010). Who has a
network and a body then tries them all (``Predictor``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from handpose.facts.cameras import Camera
from handpose.predicting.finding import BEHIND_MM, FRONT_MM2, find_hand
from netlib.blob import Array

NODES_ACROSS = 160  # the image's width in nodes: enough for a finger at 800 mm
JUMP_MM = 10.0  # more than this, and three times what is between two nodes, is another thing
FAR_MM = 1600.0  # where a hand has too few pixels to be read
THINGS = 6  # the nearest ones are looked at
ENDS = 10  # of each
LARGEST_MM2 = 32000.0  # of surface within a hand's length of an end: more is a table's corner, or a chest
SHORTEST_MM = 110.0  # from what is known to a further end
HAND_MM = 170.0  # from a fingertip along the surface, to the wrist
APART_MM = 50.0  # candidates nearer to each other are one


def candidates(depth: ArrayLike, camera: Camera) -> Array:
    """Crop centres (C, 3), px, px, mm, where a hand may be in a depth image (height, width) in mm; 0 was not read.

    Raises DataError if nothing as large as a hand is seen.
    """
    image = np.asarray(depth, dtype=np.float64)
    found = [camera.unproject(find_hand(image, camera))]  # says so if there is nothing
    nodes = _Nodes(image, camera, max(1, image.shape[1] // NODES_ACROSS))
    for thing in nodes.nearest_things():
        for center in nodes.ends_of(thing):
            if all(np.linalg.norm(center - other) > APART_MM for other in found):
                found.append(center)
    return camera.project(np.array(found))


class _Nodes:
    """Every ``step``-th pixel of an image, and which of them hang together."""

    def __init__(self, image: Array, camera: Camera, step: int) -> None:
        rows, columns = np.mgrid[step // 2 : image.shape[0] : step, step // 2 : image.shape[1] : step]
        z = image[rows, columns]
        seen = np.isfinite(z) & (z > 0) & (z < FAR_MM)
        index = np.where(seen, np.cumsum(seen).reshape(seen.shape) - 1, -1)
        self.xyz = camera.unproject(np.stack([columns[seen], rows[seen], z[seen]], axis=1))
        apart = step / camera.fx  # of neighbours, per mm of depth
        self.area = (self.xyz[:, 2] * apart) ** 2
        starts, ends = [], []
        # Two nodes apart, too: what was not read in between does not part a thing.
        for down, across in ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0)):
            here = index[: len(z) - down, max(0, -across) : z.shape[1] - max(0, across)]
            there = index[down:, max(0, across) : z.shape[1] - max(0, -across)]
            both = (here >= 0) & (there >= 0)
            starts.append(here[both])
            ends.append(there[both])
        i, j = np.concatenate(starts), np.concatenate(ends)
        far = np.abs(self.xyz[i] - self.xyz[j])
        near = far[:, 2] < JUMP_MM + 3 * apart * self.xyz[i, 2]
        i, j, length = i[near], j[near], np.linalg.norm(far[near], axis=1)
        self.graph = coo_matrix((length, (i, j)), (len(self.xyz), len(self.xyz))).tocsr()
        count, self.own = connected_components(self.graph, directed=False)
        surface = np.bincount(self.own, self.area, count)
        self.whole = np.flatnonzero(surface >= FRONT_MM2)

    def nearest_things(self) -> list[int]:
        """The nearest things that are as large as a hand."""
        depth = {int(t): np.percentile(self.xyz[self.own == t, 2], 5) for t in self.whole}
        return sorted(depth, key=lambda t: depth[t])[:THINGS]

    def ends_of(self, thing: int) -> list[Array]:
        """Middles (3,) in mm of the hands that a thing would have at its ends."""
        own = np.flatnonzero(self.own == thing)
        xyz, area, graph = self.xyz[own], self.area[own], self.graph[own][:, own]
        middle = int(np.linalg.norm(xyz - xyz.mean(axis=0), axis=1).argmin())
        away = dijkstra(graph, directed=False, indices=middle)
        found = []
        if np.ptp(xyz, axis=0).max() < 2 * HAND_MM:  # no larger than a hand
            found.append(xyz.mean(axis=0) + (0, 0, BEHIND_MM))
        for _ in range(ENDS):
            end = int(away.argmax())
            if away[end] < SHORTEST_MM:
                break
            from_end = dijkstra(graph, directed=False, indices=end)
            hand = from_end < HAND_MM
            if FRONT_MM2 < area[hand].sum() < LARGEST_MM2:
                found.append(xyz[hand].mean(axis=0) + (0, 0, BEHIND_MM))
            away = np.minimum(away, from_end)
        return found
