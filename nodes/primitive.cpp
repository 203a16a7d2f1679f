#include "graph/registry.h"
#include "kernels/shapes/primitives.h"

namespace knead {

namespace {

const char* const kManual = R"(A closed mesh made from a few numbers, so that examples and tests need no files.

`shape` is one of the list below; `size`, `radius`, `height` and `thickness` are in world units, y is up, and the middle of the shape stands at
`centre`. All shapes are closed, manifold and outward-oriented, and the same parameters give the same bits. `resolution` 0 takes the default in
brackets.

  shape    made of                                        uses              resolution r means [default]     vertices
  sphere   triangles of a split icosahedron               radius            times split in four [4]          10 * 4^r + 2
  box      quads                                          size (x, y, z)    quads along the longest side [16]  cube: 6 r^2 + 2
  plate    quads, flat along y                            size (x, z), thickness  as box [32]                as box
  capsule  quads, axis y                                  radius, height tip to tip  quads in a quarter circle [12]  6 r^2 + 4 r m + 2
  torus    quads, axis y                                  radius to the tube's middle, tube  quads around the ring [64]  r * round(r tube / radius)
  blob     triangles of one size, a lumpy body            height: about how wide  [20]                       6 r^2
  head     the same; head and neck, face towards +z       height along y    [20]                             6 r^2: 2,400
  fist     the same; right fist, knuckles up, palm +z     height: about the width of the hand  [22]           6 r^2: 2,904

For a box, the sides a, b and c quads long have 2 (ab + bc + ca) + 2 vertices; a capsule's m is the rows on its straight part. blob, head and fist are
smooth blends of ellipsoids and round cones, contoured and remeshed (kernels/shapes/implicit_mesh.h); the head by default stands two units high. A fist that
punches towards -z is one turned by [-90, 0, 0].)";

constexpr int kMostVertices = 4000000;

class Primitive : public Node {
 public:
  Param<std::string> shape{
      this, "shape", "sphere", {.choices = {"sphere", "box", "capsule", "torus", "plate", "blob", "head", "fist"}, .doc = "what to make"}};
  Param<Triple> size{this, "size", {1, 1, 1}, {.unit = "world", .doc = "sides of a box; a plate uses x and z"}};
  Param<double> radius{this, "radius", 0.5, {.min = 0, .unit = "world", .doc = "of a sphere, a capsule, or a torus's ring"}};
  Param<double> tube{this, "tube", 0.15, {.min = 0, .unit = "world", .doc = "radius of a torus's tube"}};
  Param<double> height{this, "height", 2, {.min = 0, .unit = "world", .doc = "of a capsule or head; about the width of a blob or fist"}};
  Param<double> thickness{this, "thickness", 0.05, {.min = 0, .unit = "world", .doc = "of a plate"}};
  Param<int> resolution{this, "resolution", 0, {.min = 0, .max = 1000, .doc = "how fine; see the table. 0: the shape's default"}};
  Param<Triple> centre{this, "centre", {0, 0, 0}, {.unit = "world", .doc = "where the middle of the shape stands"}};
  Out<Surface> surface{this, "surface", {.unit = "world", .doc = "the mesh"}};

  void evaluate(Context& context) const override {
    Surface made = make();
    made.placement.translation = {centre()[0], centre()[1], centre()[2]};
    context.set(surface, std::move(made));
  }

 private:
  int detail(int otherwise) const { return resolution() == 0 ? otherwise : resolution(); }
  int organic_vertices(int otherwise) const { return std::min(6 * detail(otherwise) * detail(otherwise), kMostVertices); }

  Surface make() const {
    if (shape() == "sphere") return make_sphere(radius(), detail(4));
    if (shape() == "box") return make_box({size()[0], size()[1], size()[2]}, detail(16));
    if (shape() == "plate") return make_box({size()[0], thickness(), size()[2]}, detail(32));
    if (shape() == "capsule") return make_capsule(radius(), height(), detail(12));
    if (shape() == "torus") return make_torus(radius(), tube(), detail(64));
    if (shape() == "blob") return make_blob(height(), organic_vertices(20));
    if (shape() == "head") return make_head(height(), organic_vertices(20));
    return make_fist(height(), organic_vertices(22));
  }
};

}  // namespace

KNEAD_REGISTER(primitive, Primitive, 1, kManual)

}  // namespace knead
