// What a mesh or a field is like from outside, for people: its box in the world, and what it is made of.
#pragma once
#include <limits>
#include <string>

#include "graph/api.h"
#include "graph/value.h"
#include "kernels/vec.h"

namespace knead {

// In world units. Without a point it is empty: lower above upper.
struct KNEAD_API Box {
  static constexpr double kFar = std::numeric_limits<double>::infinity();
  Vec3d lower{kFar, kFar, kFar}, upper{-kFar, -kFar, -kFar};
  void add(const Vec3d& point);
  bool empty() const { return !(lower.x <= upper.x); }
  bool holds(const Box& other) const;
  double diagonal() const;
};

KNEAD_API double gap_between(const Box& a, const Box& b);  // 0 where they touch or overlap

// Of a Surface or an Sdf; other values have an empty one.
KNEAD_API Box box_of(const Value& value);

// "mesh of 642 vertices, 1280 faces, 1 piece", "field of 20131 voxels, 0.033 wide, 1 piece". A field's pieces are those of its inside.
KNEAD_API std::string contents_of(const Value& value);

}  // namespace knead
