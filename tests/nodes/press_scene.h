// A scene of the main job that several tests run.
#pragma once

namespace press_scene {

// A box that falls on a blob that is pinned at its foot, and a ball that swells into it from the side: one collider's field is shared by the frames, the other's
// is not. Nothing touches in frame 1.
inline constexpr const char* kPress = R"(knead: 1
frames: 1-5
nodes:
  body: {type: primitive, shape: blob, resolution: 12, height: 2}
  cube: {type: primitive, shape: box, size: [0.8, 0.8, 0.8], resolution: 4}
  falls: {type: transform, mesh: cube, keys: {1: {translate: [0.1, 2.4, 0]}, 5: {translate: [0.1, 1.1, 0], rotate: [0, 40, 20]}}}
  ball: {type: primitive, shape: sphere, radius: 0.4, resolution: 3}
  swells: {type: transform, mesh: ball, keys: {1: {translate: [1.9, 0, 0], scale: 0.8}, 5: {translate: [1.15, 0, 0], scale: 1}}}
  cube_sdf: {type: mesh_to_sdf, mesh: falls, voxel_size: 0.06}
  ball_sdf: {type: mesh_to_sdf, mesh: swells, resolution: 16}
  pins: {type: weights, surface: body, region: plane, normal: [0, 1, 0], point: [0, -0.7, 0]}
  press: {type: deform, surface: body, sdf: [cube_sdf, ball_sdf], pins: pins, max_depth: 4, max_iterations: 30, stiffness: 0.4}
)";

}  // namespace press_scene
