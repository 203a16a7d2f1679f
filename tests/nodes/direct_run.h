// Runs one node without a graph: parameters and inputs by name, then evaluate. For tests of single nodes.
#pragma once
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "graph/registry.h"
#include "kernels/port_types.h"

namespace knead::direct {

class DirectRun final : public Context {
 public:
  DirectRun(void (*register_node)(Registry&), const std::string& type, const Literal::Map& arguments) : executor_(make_cpu_executor(2)) {
    Registry registry;
    register_node(registry);
    node_ = registry.find(type)->make();
    for (const auto& [name, value] : arguments) assign(*name.as_string(), value);
    node_->configure();
    inputs_.resize(node_->inputs().size());
    outputs_.resize(node_->outputs().size());
  }

  template <class T>
  DirectRun& give(const std::string& port, T value) {
    for (size_t i = 0; i < inputs_.size(); ++i)
      if (node_->inputs()[i].name == port) return inputs_[i].push_back(Value::of<T>(std::move(value))), *this;
    throw Error(ErrorCode::kInternal, "no input " + port);
  }
  DirectRun& at(int frame) {
    frame_ = frame;
    node_->evaluate(*this);
    return *this;
  }
  template <class T>
  const T& result(size_t output = 0) const {
    return outputs_[output].template as<T>();
  }
  const Node& node() const { return *node_; }
  int made_once() const { return made_once_; }

  int frame() const override { return frame_; }
  Executor& executor() const override { return *executor_; }
  bool cancelled() const override { return cancel; }
  void warn(const std::string& message) override { warnings.push_back(message); }
  void add_time(const std::string&, double) override {}
  Value once(const Key& key, FunctionRef<Value()> make) override {
    if (!once_.count(key)) {
      ++made_once_;
      once_[key] = make();
    }
    return once_[key];
  }
  const Value& input(int port, size_t i) const override { return inputs_[static_cast<size_t>(port)][i]; }
  size_t input_count(int port) const override { return inputs_[static_cast<size_t>(port)].size(); }
  void set_output(int port, Value value) override { outputs_[static_cast<size_t>(port)] = std::move(value); }

  std::vector<std::string> warnings;
  bool cancel = false;

 private:
  void assign(const std::string& name, const Literal& value) {
    for (ParamBase* param : node_->params())
      if (param->name() == name) {
        if (const std::string wrong = param->assign(value); !wrong.empty()) throw Error(ErrorCode::kGraph, name + ": " + wrong);
        return;
      }
    throw Error(ErrorCode::kGraph, "no parameter " + name);
  }

  std::unique_ptr<Executor> executor_;
  std::unique_ptr<Node> node_;
  std::vector<std::vector<Value>> inputs_;
  std::vector<Value> outputs_;
  std::map<Key, Value> once_;
  int frame_ = 1, made_once_ = 0;
};

}  // namespace knead::direct
