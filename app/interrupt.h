// Ctrl-C and its like ask a run to end cleanly; a second one ends the process at once.
#pragma once

namespace knead::app {

void catch_interrupts();  // SIGINT, SIGTERM, SIGHUP; SIGPIPE is ignored from here on
bool interrupted();

}  // namespace knead::app
