#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "graph/registry.h"
#include "io/files.h"
#include "io/picture/picture.h"
#include "kernels/parallel.h"
#include "kernels/surface/searchable_mesh.h"

namespace knead {

namespace {

const char* const kManual = R"(Writes a shaded picture of the soft surface and the colliders as PNG. `#`s in `path` and `caption` stand for the frame.

The camera looks at `focus` from `view` (front, back, left, right, top, bottom, three_quarter or [x, y, z] towards the camera) with `up` upwards (x,
y, z or a vector), through a lens of 26 degrees. At zoom 1 it shows `frame_box` [x0, y0, z0, x1, y1, z1]; without one, the box of the body at rest (of
`rest` where it is connected), widened by room for the colliders that does not depend on where they are: pictures of a sequence do not jump. Colliders
are solid, ghost (see-through, so that the dents show) or hidden. `colour` of the body:
  plain          `skin`, as flesh
  displacement   |x - x_rest|, as a fraction of the rest diagonal; needs `rest`
  penetration    depth inside the deepest collider, the same fraction; needs `colliders`
  volume_change  `values`, on a ramp with a neutral middle at 0
  weights        `values` as they are
Coloured pictures carry a scale bar over `range` [low, high]; without one, over this frame's values: give a range to compare frames. Rays are
low-discrepancy and the same for any number of threads, so a picture is the same bytes again. `samples` are the rays of a pixel on an edge; a quarter
of them gather light and soft shadow elsewhere. The file appears whole or not at all.)";

[[noreturn]] void refuse(const char* member, const std::string& message, const std::string& hint) {
  Where where;
  where.member = member;
  throw Error(ErrorCode::kGraph, where, message, hint);
}

std::vector<double> numbers_of(const Literal& literal, size_t count, const char* member, const std::string& hint) {
  std::vector<double> numbers;
  const Literal::List* list = literal.as_list();
  for (const Literal& l : list ? *list : Literal::List{})
    if (l.is_number() && std::isfinite(l.number())) numbers.push_back(l.number());
  if (!list || numbers.size() != count || list->size() != count)
    refuse(member, "expected " + std::to_string(count) + " numbers, found " + literal.text(), hint);
  return numbers;
}

class WritePicture : public Node {
 public:
  In<Surface> surface{this, "surface", {.unit = "world", .doc = "the soft surface"}};
  OptionalIn<Surface> rest{this, "rest", {.unit = "world", .doc = "the same at rest, for displacement and for the frame"}};
  ManyIn<Surface> colliders{this, "colliders", {.unit = "world", .doc = "what presses it"}};
  OptionalIn<Weights> values{this, "values", {.shape = "vertices", .doc = "what to colour by: volume_change or weights"}};
  Param<std::string> path{this, "path", "picture.####.png", {.doc = "the file; #### is the frame"}};
  Param<std::string> colour{
      this, "colour", "plain", {.choices = {"plain", "displacement", "penetration", "volume_change", "weights"}, .doc = "of the body"}};
  Param<Literal> range{this, "range", Literal{}, {.doc = "[low, high] of the scale bar; this frame's when unset"}};
  Param<std::string> look{this, "look", "solid", {.choices = {"solid", "ghost", "hidden"}, .doc = "of the colliders"}};
  Param<Literal> view{this, "view", "three_quarter", {.doc = "from where: a name or a direction"}};
  Param<Literal> up{this, "up", "y", {.doc = "what stands upright: x, y, z or a direction"}};
  Param<Literal> focus{this, "focus", Literal{}, {.unit = "world", .doc = "[x, y, z] in the middle; the frame's centre when unset"}};
  Param<Literal> frame_of_view{
      this, "frame_box", Literal{}, {.unit = "world", .doc = "[x0, y0, z0, x1, y1, z1] that fills the picture; automatic when unset"}};
  Param<double> zoom{this, "zoom", 1, {.min = 0.01, .max = 1000, .doc = "2 shows half as much"}};
  Param<int> width{this, "width", 640, {.min = 16, .max = 16384, .unit = "pixels", .doc = "of the picture; 16.7 million pixels in all are the most"}};
  Param<int> height{this, "height", 480, {.min = 16, .max = 16384, .unit = "pixels", .doc = "of the picture"}};
  Param<int> samples{this, "samples", 16, {.min = 1, .max = 1024, .doc = "rays of a pixel on an edge"}};
  Param<bool> ground{this, "ground", true, {.doc = "a floor that takes shadows"}};
  Param<Triple> skin{this, "skin", {0.74, 0.44, 0.34}, {.doc = "linear red, green, blue of the plain body, 0 to 1"}};
  Param<std::string> caption{this, "caption", "", {.doc = "at the lower left; #### is the frame"}};

  void configure() override {
    settings_ = {};
    const auto direction = [&](const Param<Literal>& param, const char* member, const std::string& hint) {
      const std::vector<double> v = numbers_of(param(), 3, member, hint);
      if (length(Vec3d{v[0], v[1], v[2]}) == 0) refuse(member, "the direction has no length", hint);
      return Vec3d{v[0], v[1], v[2]};
    };
    if (const std::string* axis = up().as_string()) {
      if (*axis != "x" && *axis != "y" && *axis != "z") refuse("up", "'" + *axis + "' is no axis", "x, y, z or a direction [x, y, z]");
      settings_.up = {*axis == "x" ? 1.0 : 0.0, *axis == "y" ? 1.0 : 0.0, *axis == "z" ? 1.0 : 0.0};
    } else {
      settings_.up = direction(up, "up", "x, y, z or a direction [x, y, z]");
    }
    if (const std::string* name = view().as_string()) {
      const std::vector<std::string> known{"front", "back", "left", "right", "top", "bottom", "three_quarter"};
      const std::optional<Vec3d> found = view_direction(*name, settings_.up);
      const std::string near = nearest_name(*name, known);
      if (!found)
        refuse("view", "unknown view '" + *name + "'",
               near.empty() ? "front, back, left, right, top, bottom, three_quarter or [x, y, z]" : "did you mean '" + near + "'?");
      settings_.view = *found;
    } else {
      settings_.view = direction(view, "view", "a name such as front, or [x, y, z] towards the camera");
    }
    if (length(cross(settings_.up, settings_.view)) <= 1e-6 * length(settings_.up) * length(settings_.view))
      refuse("view", "the camera looks along `up`", "choose another up or view");
    if (!focus().is_null())
      settings_.focus = [&] {
        const auto f = numbers_of(focus(), 3, "focus", "[x, y, z]");
        return Vec3d{f[0], f[1], f[2]};
      }();
    framed_ = !frame_of_view().is_null();
    if (framed_) {
      const auto b = numbers_of(frame_of_view(), 6, "frame_box", "[x0, y0, z0, x1, y1, z1]");
      settings_.frame = {{std::min(b[0], b[3]), std::min(b[1], b[4]), std::min(b[2], b[5])},
                         {std::max(b[0], b[3]), std::max(b[1], b[4]), std::max(b[2], b[5])}};
    }
    if (!range().is_null()) {
      const auto r = numbers_of(range(), 2, "range", "[low, high]");
      if (!(r[0] < r[1])) refuse("range", "the range is empty", "[low, high] with low < high");
      settings_.range_low = r[0];
      settings_.range_high = r[1];
    }
    settings_.width = width();
    settings_.height = height();
    settings_.samples = samples();
    settings_.zoom = zoom();
    settings_.ground = ground();
    settings_.skin = {static_cast<float>(skin()[0]), static_cast<float>(skin()[1]), static_cast<float>(skin()[2])};
    settings_.colliders = look() == "solid" ? ColliderLook::kSolid : look() == "ghost" ? ColliderLook::kGhost : ColliderLook::kHidden;
    settings_.diverging = colour() == "volume_change";
  }

  bool has_effect() const override { return true; }
  bool depends_on_frame() const override { return has_frame_pattern(path()) || has_frame_pattern(caption()); }

  void evaluate(Context& context) const override {
    PictureSettings settings = settings_;
    const Surface& body = context.get(surface);
    const Surface& still = context.get(rest) ? *context.get(rest) : body;
    std::vector<const Surface*> pressing;
    for (size_t i = 0; i < context.count(colliders); ++i) pressing.push_back(&context.get(colliders, i));
    if (!framed_) settings.frame = frame_box(still, pressing);
    settings.floor = lowest_height(still, settings.up);
    const std::vector<float> shown = shown_values(context, body, pressing);
    if (!shown.empty() && range().is_null()) fit_range(settings, shown, colour() == "displacement" || colour() == "penetration");
    settings.label = colour() == "displacement" || colour() == "penetration" ? colour() + " / diagonal"
                     : colour() == "volume_change"                           ? "volume change"
                                                                             : colour();
    settings.caption = path_in_frame(caption(), context);
    const Image image = render_picture(body, shown, pressing, settings, context.executor(), [&] { context.check_cancelled(); });
    write_png(path_in_frame(path(), context), image);
  }

 private:
  std::vector<float> shown_values(Context& context, const Surface& body, const std::vector<const Surface*>& pressing) const {
    if (colour() == "plain") return {};
    const double diagonal = body.diagonal() * body.placement.scale, per_diagonal = diagonal > 0 ? 1 / diagonal : 0;
    const auto points = body.points.host();
    std::vector<float> shown(points.size(), 0);
    if (colour() == "displacement") {
      const Surface* still = context.get(rest);
      if (!still) throw Error(ErrorCode::kInput, "displacement from what?", "connect `rest` to the undeformed surface");
      if (still->vertices() != points.size())
        throw Error(ErrorCode::kInput, "`rest` has another number of vertices than `surface`", "connect the same body");
      const auto from = still->points.host();
      for (size_t i = 0; i < points.size(); ++i)
        shown[i] = static_cast<float>(length(body.placement.apply(to_double(points[i])) - still->placement.apply(to_double(from[i]))) * per_diagonal);
    } else if (colour() == "penetration") {
      for (const Surface* collider : pressing) add_depths(context, body, *collider, per_diagonal, shown);
    } else {
      const Weights* given = context.get(values);
      if (!given) throw Error(ErrorCode::kInput, "colour by " + colour() + " has no values", "connect `values`");
      if (given->values.size() != points.size())
        throw Error(ErrorCode::kInput, std::to_string(given->values.size()) + " values for " + std::to_string(points.size()) + " vertices",
                    "connect values of the same body");
      shown.assign(given->values.host().begin(), given->values.host().end());
    }
    return shown;
  }

  static void add_depths(Context& context, const Surface& body, const Surface& collider, double per_diagonal, std::vector<float>& shown) {
    if (collider.topology->triangles.empty()) return;
    const Value made = searchable_mesh(context, collider);  // kept over frames in which the collider only moves
    const MeshDistance& solid = *made.as<SearchableMesh>().distance;
    const Similarity to_collider = collider.placement.inverse() * body.placement;
    const auto points = body.points.host();
    const Vec3d lower = solid.lower(), upper = solid.upper();
    context.executor().parallel_ranges(points.size(), kGrain, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        const Vec3d p = to_collider.apply(to_double(points[i]));
        bool near = true;  // false for NaN too
        for (int k = 0; k < 3; ++k) near = near && p[k] >= lower[k] && p[k] <= upper[k];
        if (!near || !solid.inside(p)) continue;
        const double depth = -solid.signed_distance(p).distance * collider.placement.scale * per_diagonal;
        shown[i] = std::max(shown[i], static_cast<float>(depth));
      }
    });
  }

  PictureSettings settings_;
  bool framed_ = false;
};

}  // namespace

KNEAD_REGISTER(write_picture, WritePicture, 1, kManual)

}  // namespace knead
