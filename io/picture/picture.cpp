#include "io/picture/picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "graph/error.h"
#include "io/picture/light.h"
#include "io/picture/scene.h"
#include "io/picture/text.h"

namespace knead {

namespace {

constexpr double kHalfAngle = 13 * std::numbers::pi / 180;  // of the view, upwards: a portrait lens
constexpr double kMargin = 0.94;                            // of the picture that the frame fills
constexpr int kNothing = -1, kFloor = -2;                   // RenderHit::mesh beside the meshes; the body is mesh 0
constexpr size_t kRowGrain = 8;
constexpr int64_t kMostPixels = int64_t{1} << 24;  // of about 100 bytes each while a picture is made

Vec3d unit(const Vec3d& v) {
  return v * (1 / length(v));
}

// Pinhole camera in render space.
struct Camera {
  Vec3f origin, right, up, back;
  float step = 0;  // of a pixel at distance 1
  float half_width = 0, half_height = 0;

  Vec3f through(float x, float y) const {  // pixel coordinates; the middle of the first pixel is (0.5, 0.5)
    const Vec3f d = (x - half_width) * step * right + (half_height - y) * step * up - back;
    return d * (1 / length(d));
  }
};

// World to render space: the frame's centre at the origin, its diagonal 2 long.
struct Scale {
  Vec3d centre;
  double factor = 1;
  Vec3d apply(const Vec3d& world) const { return (world - centre) * factor; }
};

Scale scale_of(const Box& frame) {
  const double diagonal = length(frame.upper - frame.lower);
  if (!std::isfinite(diagonal)) throw Error(ErrorCode::kInput, "the picture's frame is not finite", "give frame_box six numbers");
  return {0.5 * (frame.lower + frame.upper), diagonal > 0 ? 2 / diagonal : 1};
}

Camera make_camera(const PictureSettings& settings, const Scale& scale) {
  const Vec3d side = cross(settings.up, settings.view);
  if (!(length(settings.view) > 0) || !(length(settings.up) > 0) || !(length(side) > 1e-6 * length(settings.up) * length(settings.view)))
    throw Error(ErrorCode::kInput, "a camera's view and up must be two different directions",
                "view is towards the camera, up is what stands upright");
  const Vec3d back = unit(settings.view), right = unit(side), up = cross(back, right);
  const Vec3d focus = settings.focus ? scale.apply(*settings.focus) : Vec3d{0, 0, 0};
  const double rise = std::tan(kHalfAngle), run = rise * settings.width / settings.height;
  // Far enough for every corner of the frame, drawn in half-way to the ellipsoid inside it: bodies seldom fill the corners of their boxes.
  const Vec3d half = 0.5 * scale.factor * (settings.frame.upper - settings.frame.lower);
  const auto drawn_in = [&](const Vec3d& direction) {
    const Vec3d part{std::abs(half.x * direction.x), std::abs(half.y * direction.y), std::abs(half.z * direction.z)};
    return 0.5 * (length(part) + part.x + part.y + part.z);
  };
  const double near = drawn_in(back), across = drawn_in(right), along = drawn_in(up);
  const double distance = std::max(1e-3, 0.6 * near + std::max(across / run, along / rise) / kMargin);
  Camera camera;
  camera.origin = to_float(focus + back * distance);
  camera.right = to_float(right);
  camera.up = to_float(up);
  camera.back = to_float(back);
  camera.half_width = 0.5f * static_cast<float>(settings.width);
  camera.half_height = 0.5f * static_cast<float>(settings.height);
  camera.step = static_cast<float>(rise / settings.zoom * 2 / settings.height);
  return camera;
}

RenderMesh render_mesh(const Surface& surface, const Scale& scale, double crease_degrees) {
  RenderMesh mesh;
  const auto points = surface.points.host();
  mesh.points.reserve(points.size());
  for (const Vec3f& p : points) mesh.points.push_back(to_float(scale.apply(surface.placement.apply(to_double(p)))));
  const auto finite = [&](uint32_t v) {
    return std::isfinite(mesh.points[v].x) && std::isfinite(mesh.points[v].y) && std::isfinite(mesh.points[v].z);
  };
  const std::vector<uint32_t>& all = surface.topology->triangles;
  mesh.triangles.reserve(all.size());
  for (size_t t = 0; t + 2 < all.size(); t += 3)
    if (finite(all[t]) && finite(all[t + 1]) && finite(all[t + 2])) mesh.triangles.insert(mesh.triangles.end(), all.begin() + t, all.begin() + t + 3);
  mesh.corner_normals = smooth_corner_normals(mesh.points, mesh.triangles, crease_degrees);
  return mesh;
}

struct Pixel {
  RenderHit hit;
  Exposure raw, light;  // as gathered, and smoothed over neighbours
  Colour ghost;
  float ghost_cover = 0;
  bool edge = false;
};

class Renderer {
 public:
  Renderer(const PictureSettings& settings, Executor& executor, const Scale& scale)
      : settings_(settings),
        executor_(executor),
        camera_(make_camera(settings, scale)),
        up_(to_float(unit(settings.up))),
        studio_(camera_.right, camera_.up, camera_.back, up_),
        pixels_(static_cast<size_t>(settings.width) * settings.height) {
    const Vec3d half = 0.5 * scale.factor * (settings.frame.upper - settings.frame.lower);
    floor_ = -(std::abs(half.x * up_.x) + std::abs(half.y * up_.y) + std::abs(half.z * up_.z));
    if (settings.floor) floor_ = static_cast<float>((*settings.floor - dot(unit(settings.up), scale.centre)) * scale.factor);
    rays_ = std::clamp(settings.samples / 4, 1, 8);
  }

  RenderScene& solid() { return solid_; }
  RenderScene& ghosts() { return ghosts_; }

  Image run(FunctionRef<void()> progress) {
    solid_.commit();
    ghosts_.commit();
    rows([&](int x, int y) { look(x, y); });
    progress();
    rows([&](int x, int y) { gather(x, y); });
    progress();
    rows([&](int x, int y) { smooth(x, y); });
    progress();
    Image image(settings_.width, settings_.height);
    rows([&](int x, int y) {
      const Colour c = at(x, y).edge ? edge_colour(x, y) : plain_colour(x, y);
      uint8_t* out = image.at(x, y);
      out[0] = to_byte(c.r);
      out[1] = to_byte(c.g);
      out[2] = to_byte(c.b);
    });
    return image;
  }

 private:
  template <class F>
  void rows(const F& each) {
    executor_.parallel_ranges(static_cast<size_t>(settings_.height), kRowGrain, [&](size_t begin, size_t end) {
      for (size_t y = begin; y < end; ++y)
        for (int x = 0; x < settings_.width; ++x) each(x, static_cast<int>(y));
    });
  }
  Pixel& at(int x, int y) { return pixels_[static_cast<size_t>(y) * settings_.width + x]; }
  bool inside(int x, int y) const { return x >= 0 && y >= 0 && x < settings_.width && y < settings_.height; }

  // The first thing on a ray; the floor is there only where nothing else is, so that it never hides what reaches below it.
  RenderHit trace(const Vec3f& direction) const {
    RenderHit hit = solid_.first_hit(camera_.origin, direction);
    if (hit.mesh >= 0 || !settings_.ground) return hit;
    const float falling = dot(direction, up_), height = dot(camera_.origin, up_) - floor_;
    if (falling > -1e-3f || height <= 0) return hit;
    const Vec3f place = camera_.origin + direction * (-height / falling);
    if (length(place) > 4) return hit;
    hit.mesh = kFloor;
    hit.distance = -height / falling;
    hit.place = hit.lifted = place;
    hit.facet = hit.normal = up_;
    return hit;
  }

  void look(int x, int y) {
    Pixel& pixel = at(x, y);
    const Vec3f direction = camera_.through(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f);
    pixel.hit = trace(direction);
    add_ghost(direction, pixel.hit, pixel.ghost, pixel.ghost_cover);
  }

  void add_ghost(const Vec3f& direction, const RenderHit& behind, Colour& colour, float& cover) const {
    cover = 0;
    if (ghosts_.empty()) return;
    const RenderHit ghost = ghosts_.first_hit(camera_.origin, direction);
    if (ghost.mesh < 0 || (behind.mesh >= 0 && behind.distance < ghost.distance)) return;
    colour = studio_.shade_ghost(ghost, -direction, settings_.collider, cover);
  }

  void gather(int x, int y) {
    Pixel& pixel = at(x, y);
    const RenderHit& hit = pixel.hit;
    const float span = std::max(1.0f, hit.distance) * camera_.step;
    for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
      if (!inside(x + dx, y + dy)) continue;
      const Pixel& next = at(x + dx, y + dy);
      if (std::abs(next.ghost_cover - pixel.ghost_cover) > 0.08f) pixel.edge = true;
      if ((hit.mesh == kNothing || hit.mesh == kFloor) && (next.hit.mesh == kNothing || next.hit.mesh == kFloor)) continue;
      if (next.hit.mesh != hit.mesh || dot(next.hit.normal, hit.normal) < 0.9f ||
          (std::abs(dot(hit.facet, next.hit.place - hit.place)) > 4 * span && std::abs(dot(next.hit.facet, next.hit.place - hit.place)) > 4 * span))
        pixel.edge = true;
    }
    if (hit.mesh == kNothing) return;
    pixel.raw = studio_.gather(solid_, hit, flesh(hit), rays_, tile_index(x, y));
  }

  bool flesh(const RenderHit& hit) const { return hit.mesh == 0; }
  static uint32_t tile_index(int x, int y) { return static_cast<uint32_t>((x & 3) + 4 * (y & 3)) * 7 & 15; }

  static bool alike(const RenderHit& a, const RenderHit& b, float within) {
    return a.mesh == b.mesh && dot(a.normal, b.normal) > 0.8f && std::abs(dot(a.facet, b.place - a.place)) < within;
  }

  // A 5 x 5 window with half weights on its rim holds each of the tile's 16 sets of directions exactly once.
  void smooth(int x, int y) {
    Pixel& pixel = at(x, y);
    if (pixel.hit.mesh == kNothing) return;
    float total = 0, key = 0, sky = 0;
    for (int dy = -2; dy <= 2; ++dy)
      for (int dx = -2; dx <= 2; ++dx) {
        if (!inside(x + dx, y + dy)) continue;
        const Pixel& next = at(x + dx, y + dy);
        if (!alike(pixel.hit, next.hit, 0.02f)) continue;
        const float weight = (dx == -2 || dx == 2 ? 0.5f : 1.0f) * (dy == -2 || dy == 2 ? 0.5f : 1.0f);
        total += weight;
        key += weight * next.raw.key;
        sky += weight * next.raw.sky;
      }
    pixel.light = {key / total, sky / total};
  }

  Colour background(float y) const {
    const float t = std::clamp(y / (2 * camera_.half_height), 0.0f, 1.0f);
    return mix({0.50f, 0.55f, 0.61f}, {0.80f, 0.80f, 0.79f}, t * t * (3 - 2 * t));
  }

  Colour surface_colour(const RenderHit& hit, const Vec3f& direction, float y, const Exposure& light) const {
    if (hit.mesh == kNothing) return background(y);
    if (hit.mesh == kFloor) {
      const float far = std::clamp((length(hit.place) - 1) / 2.2f, 0.0f, 1.0f), near = (1 - far) * (1 - far);
      const float shade = (1 - near * 0.42f * (1 - light.key)) * (1 - near * 0.50f * (1 - light.sky));
      return mix({0, 0, 0}, background(y), shade);
    }
    if (hit.mesh > 0) return studio_.shade(hit, -direction, settings_.collider, Material::kCollider, light);
    if (!coloured) return studio_.shade(hit, -direction, settings_.skin, Material::kFlesh, light);
    const double t = (hit.value - settings_.range_low) / std::max(settings_.range_high - settings_.range_low, 1e-30);
    return studio_.shade(hit, -direction, settings_.diverging ? diverging_ramp(t) : sequential_ramp(t), Material::kPlain, light);
  }

  Colour plain_colour(int x, int y) {
    const Pixel& pixel = at(x, y);
    const Vec3f direction = camera_.through(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f);
    return mix(surface_colour(pixel.hit, direction, static_cast<float>(y), pixel.light), pixel.ghost, pixel.ghost_cover);
  }

  // More rays; their light is what alike pixels around have gathered.
  Colour edge_colour(int x, int y) {
    Colour sum;
    for (int i = 0; i < settings_.samples; ++i) {
      const double u = 0.5 + 0.7548776662466927 * i, v = 0.5 + 0.5698402909980532 * i;
      const Vec3f direction = camera_.through(static_cast<float>(x + u - std::floor(u)), static_cast<float>(y + v - std::floor(v)));
      const RenderHit hit = trace(direction);
      Exposure light;
      float total = 0;
      if (hit.mesh != kNothing) {
        light = {0, 0};
        for (int dy = -1; dy <= 1; ++dy)
          for (int dx = -1; dx <= 1; ++dx) {
            if (!inside(x + dx, y + dy)) continue;
            const Pixel& next = at(x + dx, y + dy);
            if (!alike(hit, next.hit, 0.03f)) continue;
            total += 1;
            light.key += next.light.key;
            light.sky += next.light.sky;
          }
        if (total > 0)
          light = {light.key / total, light.sky / total};
        else
          light = studio_.gather(solid_, hit, flesh(hit), 8, static_cast<uint32_t>(i));
      }
      Colour ghost;
      float cover = 0;
      add_ghost(direction, hit, ghost, cover);
      const Colour c = mix(surface_colour(hit, direction, static_cast<float>(y), light), ghost, cover);
      // Bright samples are held down so that one highlight does not own the pixel.
      sum = {sum.r + std::min(c.r, 1.2f), sum.g + std::min(c.g, 1.2f), sum.b + std::min(c.b, 1.2f)};
    }
    return mix({0, 0, 0}, sum, 1 / static_cast<float>(settings_.samples));
  }

  const PictureSettings& settings_;
  Executor& executor_;
  Camera camera_;
  Vec3f up_;
  Studio studio_;
  RenderScene solid_, ghosts_;
  std::vector<Pixel> pixels_;
  float floor_ = 0;
  int rays_ = 4;

 public:
  bool coloured = false;
};

}  // namespace

Image render_picture(const Surface& body, std::span<const float> values, const std::vector<const Surface*>& colliders,
                     const PictureSettings& settings, Executor& executor, FunctionRef<void()> progress) {
  if (settings.width < 16 || settings.height < 16 || settings.width > 16384 || settings.height > 16384)
    throw Error(ErrorCode::kInput, "a picture is 16 to 16384 pixels wide and high");
  if (static_cast<int64_t>(settings.width) * settings.height > kMostPixels)
    throw Error(ErrorCode::kInput,
                "a picture of " + std::to_string(settings.width) + " x " + std::to_string(settings.height) + " pixels would need too much memory",
                "16.7 million pixels are the most");
  if (settings.samples < 1 || settings.samples > 1024 || !(settings.zoom > 0))
    throw Error(ErrorCode::kInput, "a picture takes 1 to 1024 samples and a positive zoom");
  if (!values.empty() && values.size() != body.vertices())
    throw Error(ErrorCode::kInput, std::to_string(values.size()) + " values for " + std::to_string(body.vertices()) + " vertices",
                "give one per vertex of the surface");
  const Scale scale = scale_of(settings.frame);
  Renderer renderer(settings, executor, scale);
  RenderMesh flesh = render_mesh(body, scale, 60);
  for (const float v : values) flesh.values.push_back(std::isfinite(v) ? v : static_cast<float>(settings.range_low));
  renderer.coloured = !values.empty();
  renderer.solid().add(std::move(flesh));
  if (settings.colliders != ColliderLook::kHidden)
    for (const Surface* collider : colliders)
      (settings.colliders == ColliderLook::kSolid ? renderer.solid() : renderer.ghosts()).add(render_mesh(*collider, scale, 40));
  progress();
  Image image = renderer.run(progress);
  if (!values.empty()) draw_scale_bar(image, settings.range_low, settings.range_high, settings.diverging, settings.label);
  const int size = std::max(1, settings.height / 320);
  if (!settings.caption.empty())
    draw_text(image, 6 * size, settings.height - text_height(size) - 6 * size, settings.caption, size, {0.05f, 0.055f, 0.06f});
  return image;
}

}  // namespace knead
