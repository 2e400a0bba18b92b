// What a process says if an interrupt ends it before its command can say it.

#ifndef ISOSCOPE_CORE_CLI_END_NOTE_H_
#define ISOSCOPE_CORE_CLI_END_NOTE_H_

#include <memory>
#include <string>

namespace isoscope::cli {

// While it lives, the line with which an interrupt ends the process at once (interrupt.h) has this
// sentence: how to go on. Of several the one that was made last counts. Thread-safe.
class EndNote {
 public:
  // A sentence without its end.
  explicit EndNote(std::string sentence);
  ~EndNote();
  EndNote(const EndNote&) = delete;
  EndNote& operator=(const EndNote&) = delete;

  // It counts until the process ends: its command has still to say so by itself.
  void Keep() { is_kept_ = true; }

  // That of the process; "" if there is none.
  static std::string OfProcess();

 private:
  const std::shared_ptr<const std::string> sentence_;
  bool is_kept_ = false;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_END_NOTE_H_
