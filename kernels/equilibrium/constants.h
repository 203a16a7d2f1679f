// The numbers of the equilibrium's solver that are no parameters of the node. docs/convergence.md, table of constants, tells what half and double of each
// does. The program docs/study/constants.cpp makes that table; nothing else changes them.
#pragma once
#include <cstdint>

namespace knead {

// A descent that begins at rest moves the body as a coarse grid can at first, then as finer ones: steps of all of H would crumple fine tets under fresh
// contacts, and many more steps would be spent on smoothing them out.
struct StartConstants {
  // An H of at most this many vertices begins with itself, since few tets can crumple.
  double small_vertices = 8000;
  // A larger H begins with the finest grid of at most this many nodes.
  double first_nodes = 1500;
  // Every coarse grid makes at least this many iterations.
  double least_on_grid = 2;
  // A coarse grid is left after an iteration that takes less than this part of the energy away.
  double worth_staying = 0.1;
};

// When the metric is made anew.
struct MetricConstants {
  // On H itself the metric follows the shape after this many iterations, then after as many more, twice as many and so on.
  double interval = 4;
  // On coarse grids, where the body moves far, the metric first follows the shape at this iteration.
  double coarse_first = 1;
  // On coarse grids this is the time from the first to the second renewal.
  double coarse_interval = 2;
  // This takes the place of `interval` where the solve starts from another H's result, with a metric of nearly the right shape.
  double started_interval = 16;
  // The metric also follows the shape where refused steps have scaled the metric down to less than this, `interval` iterations after the last renewal at the
  // earliest.
  double least_scale = 0.3;
  // A renewal before this iteration makes L-BFGS forget its pairs, which tell of a body that was far from the metric's shape.
  double forget_before = 9;
  // A tet keeps its part of the metric while no cofactor has changed by more than this part of the largest.
  double tolerance = 0.05;
  // The enclosed volume's part of the metric is made anew after this many iterations.
  double volume_interval = 10;
};

// When multipliers are updated, and when contacts become stiffer.
struct MultiplierConstants {
  // In this many iterations after an update the multipliers are updated again only where the gradient is far below what is asked: else contacts and body
  // keep each other moving.
  double soon = 3;
  // This is how far below: a factor of `memory_gradient`.
  double soon_gradient = 0.3;
  // Where colliders came in, the gradient at which multipliers are updated is so many times higher: else flesh gets past the collider.
  double way_in_gradient = 4;
  // After this many updates the contacts' error should have fallen enough, else contacts become twice as stiff.
  double patience = 4;
  // The error has fallen enough when the error is below this factor of what the error was.
  double progress = 0.5;
  // Contacts become at most this many times as stiff as they began.
  double stiffest = 64;
  // The enclosed volume's stiffness over the body's own; the multiplier does the rest.
  double volume_stiffness = 10;
};

// How colliders that are in deep come in, and on which side the flesh is.
struct WayInConstants {
  // In this many iterations contacts stay on the side that was told from the rest shape; then the shape has the right side.
  double iterations_on_side = 4;
  // A collider comes in by at most this part of M's diagonal in an iteration.
  double stride = 0.01;
  // The metric is renewed after this many steps of the way in.
  double renewal = 8;
  // A way in is gone step by step when the way is this many times as long as the nearest way out of what is deepest.
  double deep = 2.1;
  // A collider comes in by at most this part of its half thickness in an iteration: else flesh gets past its middle and stays on the wrong side.
  double of_thickness = 0.25;
  // A collider's thickness asks for at most this many steps.
  double most_steps = 100;
  // The samples inside a collider agree on the way in when the sum of their normals is this part of the sum of their areas.
  double one_side = 0.3;
};

// The stopping rule, beside the node's parameters.
struct StoppingConstants {
  // At rest the enclosed volume's relative error is at most this.
  double volume = 1e-4;
  // At rest the contacts' mean error is at most this part of the largest error that is allowed.
  double mean_penetration = 0.05;
  // A step of at most this part of M's diagonal is lost in rounding.
  double still = 1e-8;
  // The solve ends after this many such steps in a row.
  double still_steps = 5;
};

// The line search, and how the metric is scaled by what the search finds.
struct LineSearchConstants {
  // A step must take this part of what the slope promises (Armijo).
  double sufficient_decrease = 1e-4;
  // The energy is uncertain by this part of itself, since float32 terms are summed.
  double energy_rounding = 2e-7;
  // The metric is scaled by this factor when a full step was refused.
  double shorter = 0.7;
  // The metric is scaled by this factor, up to 1, when a full step was taken.
  double longer = 1.05;
};

// Contacts.
struct ContactConstants {
  // A contact keeps some of its gap up to this pressure over the body's own stiffness.
  double gap_pressure = 0.5;
  // The gap takes at most this part of a field's outside band.
  double most_of_band = 0.5;
  // Samples as near to a collider as this share the pressures of a state, cells.
  double nearby = 0.2;
  // A collider is thin where its half thickness is less than this part of M's diagonal: contacts become stiffer while flesh is as deep in it as
  // `of_thickness`. A pin of radius 0.03 that is pressed 0.2 into a block of diagonal 1.73 slips through at 4 and at 10 times the stiffness, and is followed at
  // 20 and at 80 times.
  double thin = 0.08;
  // But contacts become at most so many times stiffer.
  double stiffest_for_thin = 64;
  // More samples are taken where a face is deeper in a collider than this part of M's diagonal. What is less is left to collide_sdf.
  double pierced = 1e-2;
  // So many times in a solve at most.
  double refinements = 1;
};

struct EquilibriumConstants {
  StartConstants start;
  MetricConstants metric;
  MultiplierConstants multiplier;
  WayInConstants way_in;
  StoppingConstants stopping;
  LineSearchConstants line_search;
  ContactConstants contact;
};

}  // namespace knead
