// How finely M's triangles are sampled in a frame, so that no collider slips through between two samples.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "graph/executor.h"
#include "kernels/collider_view.h"
#include "kernels/equilibrium/samples.h"

namespace knead {

// A collider as the density sees it, cells.
struct ColliderSize {
  ColliderView view;      // its field in the host's memory
  double half_thickness;  // the deepest that its inside is
};

// Into how many pieces the sides of each of M's triangles are to be cut, `least` or more: where a collider can meet the triangle, two samples are no farther
// apart than a part of the collider's half thickness. `entry`: the way that colliders came in, a unit vector, or zero; `reach`: how far along it a triangle may
// meet a collider, cells. Empty where `least` does everywhere. A function of M at rest and of the colliders alone.
std::vector<uint8_t> sample_density(Executor& host, const SampleTable& samples, std::span<const uint32_t> triangles,
                                    std::span<const ColliderSize> colliders, const Vec3f& entry, double reach, int least);

// Whether a triangle with sides of `longest_side` may have to be cut for a collider of this half thickness.
bool asks_for_samples(double longest_side, double half_thickness);

// The same where a face is deeper in a collider than `tolerance` with M's vertices at `now`: that face and all that share a corner with it are cut finer than
// `steps` says (empty: `least` everywhere). Empty where no face is, or where none can be cut finer.
std::vector<uint8_t> denser_where_pierced(Executor& host, std::span<const Vec3f> now, std::span<const uint32_t> triangles,
                                          std::span<const ColliderSize> colliders, float margin, float tolerance, const std::vector<uint8_t>& steps,
                                          int least);

}  // namespace knead
