#include "app/common.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "graph/iterate.h"
#include "graph/report.h"
#include "io/graph_file.h"

namespace knead::app {
namespace {

// Paths given by --set count from the current directory, those of write_* nodes from --out, as in the graph file.
void place_under_out(const GraphSpec& spec, const std::string& out, const std::string& name, Literal& value) {
  const std::string* path = value.as_string();
  if (!path || out.empty() || !name.ends_with(".path") || std::filesystem::path(*path).is_absolute()) return;
  const std::string node = name.substr(0, name.size() - 5);
  for (const NodeSpec& one : spec.nodes)
    if (one.name == node && one.type.starts_with("write_")) value.value = (std::filesystem::path(out) / *path).string();
}

bool is_report(const OutputDeclaration& output) {
  return output.type && same_type(*output.type, port_type<Report>());
}

std::pair<std::string, Literal> parse_set(const std::string& text) {
  const size_t equals = text.find('=');
  const std::string name = text.substr(0, equals);
  if (equals == std::string::npos || name.find('.') == std::string::npos)
    throw UsageError(fmt::format("--set {}: expected NODE.PARAMETER=VALUE, such as --set stiff.stiffness=0.3", text));
  try {
    return {name, parse_yaml(text.substr(equals + 1), "--set " + name)};
  } catch (const GraphErrors& errors) {
    throw UsageError(errors.what());
  }
}

// `results`: what is used from outside.
void find_unused(const Plan& plan, const std::string& file, const std::vector<Source>& results, bool in_loop, std::vector<std::string>& unused) {
  std::vector<bool> used(plan.nodes.size());
  const auto use = [&](const Source source) {
    if (source.node != Source::kExternal) used[static_cast<size_t>(source.node)] = true;
  };
  for (const Source source : results) use(source);
  for (const PlanNode& node : plan.nodes)
    for (const auto& port : node.inputs)
      for (const Source source : port) use(source);
  for (size_t i = 0; i < plan.nodes.size(); ++i) {
    const PlanNode& node = plan.nodes[i];
    const auto& outputs = node.node->outputs();
    const bool reports = !in_loop && std::any_of(outputs.begin(), outputs.end(), is_report);
    if (!used[i] && !reports && !node.node->has_effect() && node.where.file == file)
      unused.push_back(node.where.text() + ": nothing uses what this node makes");
    if (const auto* loop = dynamic_cast<const Iterate*>(node.node.get())) {
      std::vector<Source> next;
      for (const Iterate::State& state : loop->states()) next.push_back(state.next);
      find_unused(loop->body(), file, next, true, unused);
    }
  }
}

}  // namespace

std::shared_ptr<const Plan> load_plan(const GraphArguments& arguments) {
  CompileOptions options = graph_file_options(arguments.out);
  options.only = arguments.only;
  for (const std::string& text : arguments.sets) options.overrides.push_back(parse_set(text));
  const GraphSpec spec = [&] {
    try {
      return read_graph_file(arguments.graph, arguments.out);
    } catch (const GraphErrors&) {
      throw;
    } catch (const Error& error) {
      throw GraphErrors({error});  // a graph file that cannot be read is a wrong graph, not a failed frame
    }
  }();
  for (auto& [name, value] : options.overrides) place_under_out(spec, arguments.out, name, value);
  return compile(spec, options);
}

std::vector<ExecutorChoice> executor_choices() {
  const int threads = make_cpu_executor()->threads();
  const CudaDevices cuda = cuda_devices();
  const bool present = !cuda.devices.empty();
  return {{"cuda", present ? cuda.devices.front().name : cuda.missing, present},
          {"cpu", fmt::format("{} threads", threads), true},
          {"serial", "one thread, for finding faults", true}};
}

std::unique_ptr<Executor> make_executor(const DeviceArguments& arguments) {
  if (arguments.device == "cuda" || arguments.device == "auto")
    if (const CudaDevices cuda = cuda_devices(); !cuda.devices.empty()) return make_cuda_executor(cuda.devices.front().index);
  if (arguments.device == "auto" || arguments.device == "cpu") return make_cpu_executor(arguments.threads);
  if (arguments.device == "serial") return make_serial_executor();
  std::string why = "there is no such device", present;
  for (const ExecutorChoice& choice : executor_choices()) {
    if (choice.present) present += (present.empty() ? "" : ", ") + choice.name;
    if (choice.name == arguments.device) why = choice.description;
  }
  throw UsageError(fmt::format("--device {} is not here: {}; there are {}", arguments.device, why, present));
}

std::vector<std::string> unused_nodes(const Plan& plan) {
  std::vector<std::string> unused;
  find_unused(plan, plan.file, {}, false, unused);
  return unused;
}

std::vector<std::string> wanted_outputs(const Plan& plan, bool some_alone) {
  const std::vector<char> reached = plan.reached_from(targets_of(plan, {}));
  std::vector<std::string> wanted;
  std::vector<bool> used(plan.nodes.size());
  for (size_t i = 0; i < plan.nodes.size(); ++i) {
    const PlanNode& node = plan.nodes[i];
    bool looks_at_reached = true;
    for (const auto& port : node.inputs)
      for (const Source source : port) {
        used[static_cast<size_t>(source.node)] = true;
        looks_at_reached &= reached[static_cast<size_t>(source.node)] != 0;
      }
    if (some_alone && !reached[i] && !(looks_at_reached && node.type->name == "measure")) continue;
    for (const OutputDeclaration& output : node.node->outputs())
      if (is_report(output)) wanted.push_back(node.name + "." + output.name);
  }
  if (!plan.sinks().empty()) return wanted;
  for (size_t i = 0; i < plan.nodes.size(); ++i)
    if (const auto& outputs = plan.nodes[i].node->outputs(); !used[i] && !outputs.empty())
      wanted.push_back(plan.nodes[i].name + "." + outputs[0].name);
  return wanted;
}

std::vector<Source> targets_of(const Plan& plan, const std::vector<std::string>& outputs) {
  std::vector<Source> targets;
  for (const std::string& output : outputs) targets.push_back(plan.find(output));
  for (const int sink : plan.sinks()) targets.push_back({sink, 0});
  return targets;
}

namespace {

double seconds_of(clockid_t clock) {
  timespec time{};
  ::clock_gettime(clock, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// Since the process began: at least what it has computed; the system tells the beginning in ticks, of a hundredth of a second.
double seconds_before_main() {
  const double computed = seconds_of(CLOCK_PROCESS_CPUTIME_ID);
  std::string stat;
  std::getline(std::ifstream("/proc/self/stat"), stat);
  std::istringstream words(stat.substr(std::min(stat.size(), stat.rfind(')') + 1)));
  std::string word;
  for (int field = 3; field < 22; ++field) words >> word;
  double ticks = 0;
  if (!(words >> ticks)) return computed;
  const double tick = 1.0 / static_cast<double>(::sysconf(_SC_CLK_TCK));
  return std::max(computed, seconds_of(CLOCK_BOOTTIME) - (ticks + 0.5) * tick);
}

}  // namespace

double seconds_of_process() {
  static const auto start = std::chrono::steady_clock::now() -
                            std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(seconds_before_main()));
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

std::string counted(size_t count, const char* what) {
  return fmt::format("{} {}{}", count, what, count == 1 ? "" : "s");
}

std::string frames_text(std::vector<int> frames) {
  std::sort(frames.begin(), frames.end());
  std::string text;
  for (size_t first = 0; first < frames.size();) {
    size_t last = first;
    while (last + 1 < frames.size() && frames[last + 1] == frames[last] + 1) ++last;
    text += fmt::format("{}{}", text.empty() ? "" : ", ", frames[first]);
    if (last > first) text += fmt::format("{}{}", last == first + 1 ? ", " : "-", frames[last]);
    first = last + 1;
  }
  return text;
}

}  // namespace knead::app
