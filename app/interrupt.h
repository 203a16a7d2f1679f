// Ctrl-C and its like ask a run to end cleanly. What cannot end at once is left as it stands: the process ends a moment later, and nothing is half
// written.
#pragma once
#include <functional>

namespace knead::app {

// SIGINT, SIGTERM, SIGHUP; SIGPIPE is ignored from here on. Where the process does not end soon by itself, `last_words` is called and the process
// ends with kInterrupted, unless `is_done` says that nothing but the end itself is left. Both are called on a thread of their own: call
// `end_interrupts` before anything that they use is gone.
void catch_interrupts(std::function<bool()> is_done, std::function<void()> last_words);
void end_interrupts();
bool interrupted();

}  // namespace knead::app
