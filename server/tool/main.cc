// The `cairn` command: what a person does with trajectories, data and saved maps.
#include <exception>
#include <functional>

#include "server/tool/command.h"
#include "server/tool/eval_command.h"
#include "server/tool/map_command.h"
#include "server/tool/synth_command.h"
#include "server/tool/vocab_command.h"

int main(int argc, char** argv) {
  CLI::App app("Cairn's toolbox: evaluate trajectories, render data, look into saved maps",
               "cairn");
  app.set_version_flag("--version", CAIRN_VERSION);
  app.require_subcommand(1);
  std::function<int()> run;
  cairn::add_eval_command(app, run);
  cairn::add_map_command(app, run);
  cairn::add_synth_command(app, run);
  cairn::add_vocab_command(app, run);

  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help_or_version) {
    return app.exit(help_or_version);
  } catch (const CLI::ParseError& error) {
    return cairn::fail(std::string(error.what()) + " (see cairn --help)", cairn::kExitUsage);
  }
  try {
    return run();
  } catch (const std::exception& error) {
    return cairn::fail(error.what());
  }
}
