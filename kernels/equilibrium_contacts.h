// What presses a body in one frame (kernels/equilibrium.h): the samples of M against the colliders, each with its memory, and the volume that M
// encloses, which has a memory too.
#pragma once
#include <span>
#include <vector>

#include "kernels/contact_body.h"
#include "kernels/equilibrium_rest.h"
#include "kernels/rows.h"

namespace knead {

class EquilibriumContacts {
 public:
  EquilibriumContacts(Executor& executor, const EquilibriumRest& rest, const Similarity& placement, std::span<const Sdf* const> colliders,
                      const EquilibriumSettings& settings);

  // Energy and forces with H displaced by u. `travelled`: how far any vertex of H has gone since the last call of list_samples, or more.
  ContactSum evaluate(const Row4* u, float travelled);
  const Row4* pushes() const { return push_.host().data(); }  // by place: the samples' forces
  // By vertex of M, to be added to that: what acts on all of them at once. Null when nothing does.
  const Row4* forces() const { return keeps_volume() ? force_.host().data() : nullptr; }

  // Finds the samples that may come in contact before H has travelled skin().
  void list_samples(const Row4* u);
  float skin() const { return skin_; }

  // A collider whose samples agree on where it came from holds the samples that began inside it by the way in, not by the nearest way out. Whether
  // there is one; call at rest, after evaluate.
  bool find_entries();
  bool by_entries() const { return body_.exits != nullptr; }
  void forget_entries() { body_.exits = nullptr; }

  // lambda <- max(0, lambda - phi) after evaluate; the same for the volume.
  void update_memory();
  // Stiffer contacts under the same forces.
  void stiffen(float by);

  // Adds what the samples that push are worth to the metric's diagonal, by place.
  void add_to(std::span<float> diagonal, float share) const;

  bool keeps_volume() const { return !rest_.fans.empty(); }
  double volume_error() const { return volume_error_; }
  double volume_compliance() const;  // the inverse of the enclosed volume's second derivative along its gradient
  // The gradient of the enclosed volume by place, of the last evaluate.
  void volume_gradient(Row4* by_place) const;

 private:
  double add_volume();
  void spread();
  size_t samples() const { return rest_.samples.size(); }

  Executor& executor_;
  const EquilibriumRest& rest_;
  ContactEnergy body_{};
  Buffer<Row4> force_, push_, now_, volume_gradient_;
  Buffer<float> memory_, distance_;
  std::vector<float> slack_, exits_;
  std::vector<uint32_t> list_, pushed_;  // samples that may push; places that are pushed
  float skin_;
  double rest_volume_ = 0, volume_error_ = 0, volume_memory_ = 0;
};

}  // namespace knead
