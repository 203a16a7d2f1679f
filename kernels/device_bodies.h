// Internal: the bodies that devices run, for device_bodies.cu and for builds without CUDA.
#pragma once
#include "kernels/collide_body.h"
#include "kernels/enforce_stiffness_body.h"
#include "kernels/lattice_map_body.h"
#include "kernels/loop_points.h"
#include "kernels/multigrid_body.h"
#include "kernels/parallel.h"
#include "kernels/restore_volume_body.h"
#include "kernels/rigid_fit_body.h"
#include "kernels/unrest_body.h"
