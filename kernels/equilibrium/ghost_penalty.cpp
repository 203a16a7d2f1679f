#include "kernels/equilibrium/ghost_penalty.h"

#include <algorithm>
#include <cmath>

namespace knead {
namespace {

struct Face {
  std::array<uint32_t, 3> corners;  // rising
  uint32_t tet, apex;
};

struct Term {
  uint32_t row, column;
  double value;
};

// Those that a tet of less than whole weight may have, in order.
std::vector<Face> faces_of(std::span<const std::array<uint32_t, 4>> corners, size_t places, std::span<const float> weights) {
  std::vector<uint8_t> weak(places, 0);
  for (size_t t = 0; t < corners.size(); ++t)
    for (const uint32_t p : corners[t]) weak[p] |= weights[t] < 1;
  std::vector<Face> faces;
  for (uint32_t t = 0; t < corners.size(); ++t)
    for (size_t skip = 0; skip < 4; ++skip) {
      Face face{{0, 0, 0}, t, corners[t][skip]};
      bool all = true;
      for (size_t c = 0, n = 0; c < 4; ++c) {
        if (c == skip) continue;
        face.corners[n++] = corners[t][c];
        all = all && weak[corners[t][c]];
      }
      if (!all) continue;
      std::sort(face.corners.begin(), face.corners.end());
      faces.push_back(face);
    }
  std::sort(faces.begin(), faces.end(), [](const Face& a, const Face& b) { return a.corners != b.corners ? a.corners < b.corners : a.tet < b.tet; });
  return faces;
}

// The jump over a face is that of the derivative along its normal n: one vector, sum_c j_c u_c with j_c = grad N_c . n here minus there. Apexes at heights h
// and k on the two sides have j = 1 / h and 1 / k, and a corner of the face makes up for what the apexes' feet have of it.
class Jump {
 public:
  Jump(std::span<const Vec3d> rest, const Face& here, const Face& there)
      : places_{here.corners[0], here.corners[1], here.corners[2], here.apex, there.apex} {
    const Vec3d a = rest[places_[0]], b = rest[places_[1]] - a, c = rest[places_[2]] - a;
    const Vec3d twice = cross(b, c);
    area_ = 0.5 * length(twice);
    const Vec3d normal = (1 / (2 * area_)) * twice;
    for (size_t side = 0; side < 2; ++side) {
      const Vec3d y = rest[places_[3 + side]] - a;
      const double height = std::abs(dot(y, normal)), over = 1 / dot(twice, twice);
      const double beta = over * dot(cross(y, c), twice), gamma = over * dot(cross(b, y), twice);
      factors_[3 + side] = 1 / height;
      factors_[0] -= (1 - beta - gamma) / height;
      factors_[1] -= beta / height;
      factors_[2] -= gamma / height;
      volume_ += area_ * height / 3;
    }
  }
  double volume() const { return volume_; }
  void add(double scale, std::vector<Term>& terms) const {
    for (size_t i = 0; i < 5; ++i)
      for (size_t k = 0; k < 5; ++k)
        if (i != k) terms.push_back({places_[i], places_[k], scale * factors_[i] * factors_[k]});
  }

 private:
  std::array<uint32_t, 5> places_;
  std::array<double, 5> factors_{};
  double area_ = 0, volume_ = 0;
};

}  // namespace

SparseRows ghost_penalty(std::span<const std::array<uint32_t, 4>> corners, std::span<const Vec3d> rest, std::span<const float> weights,
                         std::span<const float> stiffness, double factor) {
  const std::vector<Face> faces = faces_of(corners, rest.size(), weights);
  std::vector<Term> terms;
  for (size_t f = 0; f + 1 < faces.size(); ++f) {
    const Face &here = faces[f], &there = faces[f + 1];
    if (here.corners != there.corners) continue;
    const double missing = 1 - static_cast<double>(std::min(weights[here.tet], weights[there.tet]));
    if (missing <= 0) continue;
    const Jump jump(rest, here, there);
    jump.add(factor * missing * 0.5 * (static_cast<double>(stiffness[here.tet]) + stiffness[there.tet]) * jump.volume(), terms);
  }
  std::sort(terms.begin(), terms.end(), [](const Term& a, const Term& b) { return a.row != b.row ? a.row < b.row : a.column < b.column; });
  SparseRows rows;
  rows.offsets.assign(rest.size() + 1, 0);
  for (size_t i = 0; i < terms.size();) {
    double sum = 0;
    size_t end = i;
    for (; end < terms.size() && terms[end].row == terms[i].row && terms[end].column == terms[i].column; ++end) sum += terms[end].value;
    rows.index.push_back(terms[i].column);
    rows.value.push_back(static_cast<float>(sum));
    ++rows.offsets[terms[i].row + 1];
    i = end;
  }
  for (size_t p = 0; p < rest.size(); ++p) rows.offsets[p + 1] += rows.offsets[p];
  return rows;
}

}  // namespace knead
