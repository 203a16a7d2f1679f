// What an evaluation of the equilibrium's energy leaves behind, in the executor's memory: on a device the one thing that the host reads back.
#pragma once
#include "kernels/equilibrium/contact_body.h"
#include "kernels/equilibrium/elastic_body.h"
#include "kernels/equilibrium/enclosed_volume_body.h"
#include "kernels/equilibrium/gather_forces_body.h"

namespace knead {

struct EquilibriumSums {
  ElasticSum elastic;
  ContactSum contact;
  EnclosedVolume volume;
  GatherForces::Sum forces;
  float travelled = 0;  // how far any vertex of H has gone since contacts were listed, cells
  float from_rest = 0;  // how far any vertex of H was from rest then, cells; 0 where all colliders are met
  float step = 0;       // how far any vertex of H has gone in the last step, cells
  double slope = 0;     // of the energy along the direction
};

}  // namespace knead
