// The paper's loop with Anderson acceleration, for the study of convergence (docs/convergence.md): `knead run` for one frame, with one more node type.
//
//   anderson GRAPH FOLDER
//
// `anderson` stands at the end of a loop's body. From H at a round's beginning and at its end it makes the next round's beginning (Anderson 1965; Walker
// and Ni 2011, type II): with the residuals f = end - beginning of the last rounds, the combination of them that is least in the sum of squares.
#include <Eigen/Dense>
#include <cstdio>
#include <filesystem>
#include <fstream>

#include "graph/evaluator.h"
#include "graph/registry.h"
#include "io/graph_file.h"
#include "io/stats.h"
#include "kernels/port_types.h"

namespace {

using namespace knead;

constexpr size_t kRemembered = 5;
constexpr double kRegularisation = 1e-10;  // of the largest square: differences may be nearly alike

// History: [beginning, residual] of the round before, then [change of beginning, change of residual] of earlier rounds, newest first.
class Anderson : public Node {
 public:
  In<Points> before{this, "before", {.doc = "H at the round's beginning"}};
  In<Points> after{this, "after", {.doc = "H at its end"}};
  OptionalIn<Points> history{this, "history", {.doc = "of earlier rounds"}};
  Out<Points> points{this, "points", {.doc = "H at the next round's beginning"}};
  Out<Points> remembered{this, "history", {.doc = "for the next round"}};

  void evaluate(Context& context) const override {
    const auto x = floats(context.get(before)), end = floats(context.get(after));
    const Eigen::VectorXf f = end - x;
    const Eigen::Index n = x.size();
    Eigen::MatrixXf columns(n, 2);
    columns << x, f;
    Eigen::VectorXf next = end;
    if (const Points* earlier = context.get(history)) {
      const auto all = floats(*earlier);
      const Eigen::Map<const Eigen::MatrixXf> old(all.data(), n, all.size() / n);
      const Eigen::Index pairs = std::min<Eigen::Index>(old.cols() / 2, kRemembered);
      columns.conservativeResize(n, 2 + 2 * pairs);
      columns.col(2) = x - old.col(0);
      columns.col(3) = f - old.col(1);
      columns.rightCols(2 * (pairs - 1)) = old.middleCols(2, 2 * (pairs - 1));
      Eigen::MatrixXd steps(n, pairs), changes(n, pairs);
      for (Eigen::Index k = 0; k < pairs; ++k) {
        steps.col(k) = columns.col(2 + 2 * k).cast<double>();
        changes.col(k) = columns.col(3 + 2 * k).cast<double>();
      }
      Eigen::MatrixXd squares = changes.transpose() * changes;
      squares.diagonal().array() += kRegularisation * squares.diagonal().maxCoeff();
      const Eigen::VectorXd part = squares.ldlt().solve(changes.transpose() * f.cast<double>());
      if (part.allFinite()) next -= ((steps + changes) * part).cast<float>();
    }
    context.set(points, Points{buffer(next.data(), n)});
    context.set(remembered, Points{buffer(columns.data(), columns.size())});
  }

 private:
  static Eigen::Map<const Eigen::VectorXf> floats(const Points& points) {
    const auto values = points.values.host();
    return {&values[0].x, static_cast<Eigen::Index>(3 * values.size())};
  }
  static Buffer<Vec3f> buffer(const float* from, Eigen::Index count) {
    Buffer<Vec3f> made(static_cast<size_t>(count) / 3);
    std::copy_n(from, count, &made.data_for_write()->x);
    return made;
  }
};

}  // namespace

int main(int count, char** words) try {
  if (count != 3) {
    std::fputs("anderson GRAPH FOLDER\n", stderr);
    return 3;
  }
  Registry registry = Registry::builtin();
  registry.add({"anderson", 1, "", [] { return std::unique_ptr<Node>(std::make_unique<Anderson>()); }, {}});
  CompileOptions options = graph_file_options(words[2]);
  options.registry = &registry;
  std::filesystem::create_directories(words[2]);
  Evaluator evaluator(compile(read_graph_file(words[1], words[2]), options));
  std::vector<Source> targets;
  std::vector<std::string> outputs;
  for (const auto& [name, source] : evaluator.plan().names)
    if (name.ends_with("_m.report")) targets.push_back(source), outputs.push_back(name);
  const FrameResult result = evaluator.evaluate(1, outputs, true);
  if (result.error) throw *result.error;
  std::ofstream(std::filesystem::path(words[2]) / "stats.jsonl") << stats_line(result, stats_nodes(evaluator.plan(), targets), {}) << '\n';
  return 0;
} catch (const knead::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
