#include "graph/registry.h"

namespace knead {
namespace {

constexpr const char* kManual = R"(A graph file used as a node.

`path` is the file, relative to the graph that uses it. Its `inputs` are this node's inputs, its `parameters` this node's parameters, its `outputs`
this node's outputs; the first output is the default. Inside the file, nodes read an input as `inputs.NAME` and a parameter as `$NAME`.

A group costs nothing at run time: its nodes become nodes of the outer graph, named `GROUP.NODE`, are cached one by one, and can be reached by
`--set GROUP.NODE.param=value`.)";

class Group : public Node {
 public:
  Param<std::string> path{this, "path", "", {.doc = "the graph file"}};
  void evaluate(Context&) const override { throw Error(ErrorCode::kInternal, "a group was not expanded"); }
};

}  // namespace

KNEAD_REGISTER(group, Group, 1, kManual)

}  // namespace knead
