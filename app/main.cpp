// The program `knead`: what the command line says, and exit statuses. Every command has a file of its own.
#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>

#include "app/commands.h"
#include "app/common.h"
#include "app/strict.h"

namespace knead::app {
namespace {

void log_to_stderr() {
  auto logger = spdlog::stderr_color_mt("knead");
  logger->set_pattern("%^%l%$: %v");
  spdlog::set_default_logger(std::move(logger));
}

void add_graph(CLI::App& command, GraphArguments& arguments) {
  command.add_option("GRAPH", arguments.graph, "the graph file (YAML or JSON)")->required();
  command.add_option("--set", arguments.sets, "NODE.PARAMETER=VALUE: another value than the graph file's; may be repeated")->allow_extra_args(false);
}

void add_device(CLI::App& command, DeviceArguments& arguments) {
  command.add_option("--device", arguments.device, "auto, serial, cpu or cuda")
      ->check(CLI::IsMember({"auto", "serial", "cpu", "cuda"}))
      ->capture_default_str();
  command.add_option("--threads", arguments.threads, "threads of the cpu executor; 0: as many as there are")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
}

struct Arguments {
  RunArguments run;
  std::string node;
  bool dot = false, schema = false, stats_schema = false, markdown = false;
  std::function<int()> command;
};

void declare_run(CLI::App& program, Arguments& all) {
  CLI::App* run_command = program.add_subcommand("run", "make the frames of a graph");
  add_graph(*run_command, all.run.graph);
  add_device(*run_command, all.run.device);
  run_command->add_option("--frames", all.run.frames, "such as 12, 1-48, 1-48x2 or 1-10,20; otherwise those the graph file names");
  run_command->add_option("--out", all.run.graph.out, "folder in which relative paths of write_* nodes begin; otherwise the current one");
  run_command->add_option("--stats", all.run.stats, "where the figures go, a line of JSON per frame; otherwise stats.jsonl in --out");
  run_command
      ->add_option("--only", all.run.graph.only,
                   "a node that writes, or a group of such: these alone write, and only what they need is made; several by commas, or repeated")
      ->delimiter(',')
      ->allow_extra_args(false);
  run_command->add_flag("--resume", all.run.resume, "skip frames that are complete and were made from the same inputs");
#ifdef KNEAD_PICTURES
  run_command->add_flag("--sheet", all.run.sheet, "make a contact sheet of every sequence of pictures");
#endif
  run_command->add_option(
      "--strict", all.run.strict,
      "end with status 4 where a frame is not good enough: did not come to rest (rest), carries warnings (warnings), or has a figure "
      "beyond a limit (penetration=1e-3); alone: rest,warnings");
  run_command->add_flag("--checked", all.run.checked, "prove that nodes read only what they declare (slow)");
  run_command->add_flag("-q,--quiet", all.run.quiet, "print warnings, errors and what did not go well only");
  run_command->callback([&] { all.command = [&] { return run(all.run); }; });
}

void declare(CLI::App& program, Arguments& all) {
  program.set_version_flag("--version", "knead " KNEAD_VERSION);
  program.require_subcommand(1);
  program.footer("Exit status: 0 all good, 1 the graph is wrong, 2 some frame failed, 3 usage, 4 not good enough for --strict, 130 interrupted.");

  declare_run(program, all);

  CLI::App* check_command = program.add_subcommand("check", "name all errors of a graph");
  add_graph(*check_command, all.run.graph);
  check_command->callback([&] { all.command = [&] { return check(all.run.graph); }; });

  CLI::App* graph_command = program.add_subcommand("graph", "show a graph and its schedule");
  add_graph(*graph_command, all.run.graph);
  add_device(*graph_command, all.run.device);
  graph_command->add_flag("--dot", all.dot, "as Graphviz input");
  graph_command->callback([&] { all.command = [&] { return show_graph(all.run.graph, all.run.device, all.dot); }; });

  CLI::App* nodes_command = program.add_subcommand("nodes", "the node types, and the page of one");
  nodes_command->add_option("NAME", all.node, "a node type");
  nodes_command->add_flag("--schema", all.schema, "the JSON schema of graph files");
  nodes_command->add_flag("--stats-schema", all.stats_schema, "the JSON schema of a line of stats.jsonl");
  nodes_command->add_flag("--markdown", all.markdown, "all node types as the page docs/nodes.md");
  nodes_command->callback([&] { all.command = [&] { return show_nodes(all.node, all.schema, all.stats_schema, all.markdown); }; });

  CLI::App* info_command = program.add_subcommand("info", "version, executors, libraries");
  info_command->callback([&] { all.command = show_info; });
}

// `--strict` may stand alone before another word: only limits are taken as its value.
std::vector<std::string> words_of(int count, char** words) {
  std::vector<std::string> all;
  for (int i = count - 1; i > 0; --i) {  // CLI11 takes them from the back
    all.emplace_back(words[i]);
    if (all.back() == "--strict" && (all.size() == 1 || !is_strictness(all[all.size() - 2]))) all.back() = std::string("--strict=") + kStrictAlone;
  }
  return all;
}

int guarded(const std::function<int()>& command) {
  try {
    return command();
  } catch (const UsageError& error) {
    fmt::print(stderr, "{}\n", error.what());
    return kUsage;
  } catch (const GraphErrors& errors) {
    fmt::print(stderr, "{}\n", errors.what());
    return kGraphWrong;
  } catch (const Error& error) {
    fmt::print(stderr, "{}\n", error.what());
    return error.code() == ErrorCode::kGraph ? kGraphWrong : kFrameFailed;
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}\n", error.what());
    return kFrameFailed;
  }
}

}  // namespace
}  // namespace knead::app

int main(int count, char** words) {
  using namespace knead::app;
  seconds_of_process();
  log_to_stderr();
  CLI::App program("Deforms soft surfaces where hard objects press into them, frame by frame.", "knead");
  Arguments arguments;
  declare(program, arguments);
  try {
    program.parse(words_of(count, words));
  } catch (const CLI::ParseError& error) {
    return program.exit(error) == 0 ? kGood : kUsage;
  }
  const int status = guarded(arguments.command);
  if (std::fflush(stdout) != 0 || std::ferror(stdout)) {
    fmt::print(stderr, "the output could not be written\n");
    return status == kGood ? kFrameFailed : status;
  }
  return status;
}
