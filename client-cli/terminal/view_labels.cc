#include "client-cli/terminal/view_labels.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace isoscope::cli {
namespace {

// Of the labels around a highlighted one; that of the page.
constexpr float kFaintOpacity = 0.15F;

std::string FlagOf(const client::LabelSurface& label) {
  std::string text = absl::StrCat("--label ", TextOfValues(label.values));
  const bool has_opacity = label.color.alpha != 1;
  if (label.is_color_given) {
    absl::StrAppendFormat(&text, ":%.9g,%.9g,%.9g", label.color.red, label.color.green,
                          label.color.blue);
  } else if (has_opacity) {
    absl::StrAppend(&text, ":");
  }
  if (has_opacity) {
    absl::StrAppendFormat(&text, ":%.9g", label.color.alpha);
  }
  return text;
}

}  // namespace

std::string TextOfValues(const std::vector<double>& values) {
  const auto follows = [&](std::size_t i) {
    return i + 1 < values.size() && values[i] >= 0 && values[i] == std::floor(values[i]) &&
           values[i + 1] == values[i] + 1;
  };
  std::vector<std::string> parts;
  for (std::size_t i = 0; i < values.size();) {
    std::size_t end = i;
    while (follows(end)) {
      ++end;
    }
    if (end > i + 1) {  // a range of two is as long as both
      parts.push_back(absl::StrFormat("%.17g-%.17g", values[i], values[end]));
      i = end + 1;
    } else {
      parts.push_back(absl::StrFormat("%.17g", values[i]));
      ++i;
    }
  }
  return absl::StrJoin(parts, ",");
}

std::string FlagsOfLabels(const std::vector<client::LabelSurface>& labels) {
  std::vector<std::string> flags;
  for (const client::LabelSurface& label : labels) {
    flags.push_back(FlagOf(label));
  }
  if (std::any_of(labels.begin(), labels.end(),
                  [](const client::LabelSurface& label) { return label.is_smooth; })) {
    flags.emplace_back("--smooth-labels");
  }
  return absl::StrJoin(flags, " ");
}

std::vector<client::LabelSurface> ShownLabels(const std::vector<client::LabelSurface>& labels,
                                              const LabelChoice& choice) {
  std::vector<client::LabelSurface> shown;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    const LabelChoice::Look look = choice.LookOf(i);
    if (look == LabelChoice::Look::kHidden) {
      continue;
    }
    float& alpha = shown.emplace_back(labels[i]).color.alpha;
    if (look == LabelChoice::Look::kHighlighted) {
      alpha = 1;
    } else if (look == LabelChoice::Look::kFaint) {
      alpha = std::min(alpha, kFaintOpacity);
    }
  }
  return shown;
}

std::string DescribeLabels(const std::vector<client::LabelSurface>& labels,
                           const LabelChoice& choice) {
  if (const std::optional<std::size_t> chosen = choice.chosen()) {
    return absl::StrCat(labels[*chosen].name, " (", *chosen + 1, " of ", labels.size(), ")",
                        choice.is_highlighted() ? " highlighted" : "");
  }
  if (const std::size_t hidden = choice.hidden_count(); hidden > 0) {
    return absl::StrCat(labels.size() - hidden, " of ", labels.size(), " labels");
  }
  return labels.size() == 1 ? labels[0].name : absl::StrCat(labels.size(), " labels");
}

}  // namespace isoscope::cli
