// The tets around each vertex as strips of triangles over its link, so that a kernel that goes round a vertex reads one new vertex per tet instead of
// three.
//
// A lane keeps the three vertices it met last, (p, q, r). An entry brings a vertex n: the three become (q, r, n), or (p, r, n) where the entry's
// value has the sign of the value before it (zeros have signs too; the first entry's predecessor is +0). The value is 1 / (6 V0) where the three are
// then a tet's other corners, positive if dot(r - a, cross(p - r, q - r)) of the three is six times a positive volume about the lane's vertex a at
// rest, negative where it is the opposite, and zero where the vertex only starts a strip. Neighbouring triangles of a link that are walked so
// alternate in sign or keep it just as the rule says. A link of n triangles takes n + 2 entries when one strip covers it.
#pragma once
#include "graph/executor.h"
#include "kernels/port_types.h"

namespace knead {

// From a table of three columns per neighbour, the other corners (b, c, d) of each tet with dot(d - a, cross(b - d, c - d)) > 0, and V0 > 0. Each
// strip is walked towards the triangle with the fewest neighbours left, which leaves few behind.
NeighbourTable make_strips(const NeighbourTable& vertex_tets, Executor& executor);

}  // namespace knead
