// The colliders that M can meet. The kernels know no others, so that 200 colliders cost what those cost that come near: a collider is taken in when H has
// moved so far from rest that the collider may have a force, and stays.
#pragma once
#include <limits>
#include <vector>

#include "graph/executor.h"
#include "kernels/collider_view.h"
#include "kernels/equilibrium/rest_tables.h"

namespace knead {

class MetColliders {
 public:
  MetColliders() = default;
  // `views`: of all colliders, seen from tet space. None is met yet.
  MetColliders(Executor& executor, const SampleTable& samples, std::vector<ColliderView> views);

  // Takes in what may have a force before H has travelled this far from rest, cells. Whether anything was.
  bool meet(double travelled);
  bool take_in(size_t collider);  // whether it was not met before
  bool all_met() const { return met_.size() == all_.size(); }
  double nearest_unmet() const { return nearest_unmet_; }  // how far H may travel from rest without meeting another one, cells

  // In the order in which they were met: by slot.
  uint32_t count() const { return static_cast<uint32_t>(met_.size()); }
  uint32_t collider(size_t slot) const { return met_[slot]; }
  static constexpr uint32_t kUnmet = ~0u;
  uint32_t slot(size_t collider) const { return slots_[collider]; }
  const ColliderView& original(size_t collider) const { return all_[collider]; }

  // By slot, on the host; the two functions bring them to where the kernels read them: on a device a transfer each.
  std::vector<ColliderView> views;
  std::vector<Vec3f> entries;  // unit, the way a collider came in; zero: not known
  const ColliderView* published_views(Executor& executor);
  const Vec3f* published_entries(Executor& executor);

 private:
  void find_nearest_unmet();

  std::vector<ColliderView> all_;
  std::vector<float> away_;  // per collider: how far H may travel from rest until it may have a force, cells
  std::vector<uint32_t> met_, slots_;
  double nearest_unmet_ = std::numeric_limits<double>::infinity();
  Buffer<ColliderView> views_there_;
  Buffer<Vec3f> entries_there_;
};

}  // namespace knead
