// Which surfaces of labels `view --terminal` shows: the same choices as the list of the page.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_LABEL_CHOICE_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_LABEL_CHOICE_H_

#include <cstddef>
#include <optional>
#include <vector>

namespace isoscope::cli {

// Labels are numbered from 0. One of them may be chosen: it is shown alone, or highlighted. Without
// one all are shown that are not hidden. Thread-compatible.
class LabelChoice {
 public:
  // shows_others: whether the view has other surfaces, so that all labels may be hidden
  LabelChoice(std::size_t count, bool shows_others)
      : shows_others_(shows_others), hidden_(count, false) {}

  // Each returns whether the view has changed.

  // Chooses the next label, or the one before, that is not hidden; behind the last one none.
  bool Step(bool is_forward);
  // Hides the chosen label, or shows it again.
  bool ToggleHidden();
  // Lets the others show through, or hides them again. Chooses the first label if there is none.
  bool ToggleHighlight();
  bool ShowAll();

  enum class Look { kHidden, kFaint, kPlain, kHighlighted };
  [[nodiscard]] Look LookOf(std::size_t label) const;
  [[nodiscard]] std::optional<std::size_t> chosen() const;
  [[nodiscard]] bool is_highlighted() const { return is_highlighted_ && chosen().has_value(); }
  [[nodiscard]] std::size_t hidden_count() const;

 private:
  const bool shows_others_;
  std::vector<bool> hidden_;
  // A place of the circle: 0 is that of all, label i is at i + 1. A label that was hidden keeps the
  // place, so that the next one follows.
  std::size_t place_ = 0;
  bool is_highlighted_ = false;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_LABEL_CHOICE_H_
