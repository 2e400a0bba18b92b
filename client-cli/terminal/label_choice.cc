#include "client-cli/terminal/label_choice.h"

#include <algorithm>

namespace isoscope::cli {

bool LabelChoice::Step(bool is_forward) {
  if (hidden_.empty()) {
    return false;
  }
  do {
    place_ = (place_ + (is_forward ? 1 : hidden_.size())) % (hidden_.size() + 1);
  } while (place_ > 0 && hidden_[place_ - 1]);
  return true;
}

bool LabelChoice::ToggleHidden() {
  if (place_ == 0) {
    return false;
  }
  const std::size_t label = place_ - 1;
  if (!hidden_[label] && !shows_others_ && hidden_count() + 1 == hidden_.size()) {
    return false;  // a picture needs a surface
  }
  hidden_[label] = !hidden_[label];
  return true;
}

bool LabelChoice::ToggleHighlight() {
  if (!chosen()) {
    is_highlighted_ = true;
    return hidden_count() < hidden_.size() && Step(/*is_forward=*/true);
  }
  is_highlighted_ = !is_highlighted_;
  return true;
}

bool LabelChoice::ShowAll() {
  const bool has_changed = chosen().has_value() || hidden_count() > 0;
  std::fill(hidden_.begin(), hidden_.end(), false);
  place_ = 0;
  is_highlighted_ = false;
  return has_changed;
}

LabelChoice::Look LabelChoice::LookOf(std::size_t label) const {
  const std::optional<std::size_t> one = chosen();
  if (hidden_[label] || (one && *one != label && !is_highlighted_)) {
    return Look::kHidden;
  }
  if (!one || !is_highlighted_) {
    return Look::kPlain;
  }
  return *one == label ? Look::kHighlighted : Look::kFaint;
}

std::optional<std::size_t> LabelChoice::chosen() const {
  return place_ > 0 && !hidden_[place_ - 1] ? std::optional(place_ - 1) : std::nullopt;
}

std::size_t LabelChoice::hidden_count() const {
  return static_cast<std::size_t>(std::count(hidden_.begin(), hidden_.end(), true));
}

}  // namespace isoscope::cli
