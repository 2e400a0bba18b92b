#include "core/formats/format_table.h"

#include <algorithm>
#include <array>
#include <cstddef>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"

#include "core/source/bytes/object_key.h"
#include "core/source/bytes/part_path.h"

namespace isoscope::source {

std::string FormatNameOf(const Format& format) {
  return absl::StrReplaceAll(absl::AsciiStrToLower(format.name), {{" ", "-"}});
}

const Format* FindFormat(absl::string_view name, absl::Span<const Format> formats) {
  const auto found = std::find_if(formats.begin(), formats.end(), [&](const Format& format) {
    return absl::EqualsIgnoreCase(FormatNameOf(format), name);
  });
  return found == formats.end() ? nullptr : &*found;
}

std::string ListedFormats(absl::Span<const Format> formats) {
  std::vector<std::string> texts;
  for (const Format& format : formats) {
    if (!format.endings.empty()) {
      texts.push_back(absl::StrCat(format.name, " (", absl::StrJoin(format.endings, " "), ")"));
    }
  }
  return absl::StrJoin(texts, ", ");
}

std::vector<FormatName> FormatNames(absl::Span<const Format> formats) {
  std::vector<FormatName> names;
  for (const Format& format : formats) {
    std::vector<std::string> files;
    for (const std::string& text : {absl::StrJoin(format.endings, " "), format.more_names}) {
      if (!text.empty()) {
        files.push_back(text);
      }
    }
    names.push_back({FormatNameOf(format),
                     files.empty() ? "by content" : absl::StrJoin(files, ", "),
                     format.is_forceable});
  }
  return names;
}

std::string FieldNameOf(absl::string_view path, absl::Span<const Format> formats) {
  constexpr std::array<absl::string_view, 12> kNameEndings{{".gz", ".nii", ".hdr", ".img", ".nrrd",
                                                            ".nhdr", ".mha", ".mhd", ".tif",
                                                            ".tiff", ".dcm", ".rec"}};
  const std::string whole = LastPartOfPath(path);
  absl::string_view name = whole;
  for (const absl::string_view ending : kNameEndings) {
    if (absl::EndsWithIgnoreCase(name, ending)) {
      name.remove_suffix(ending.size());
    }
  }
  for (const Format& format : formats) {
    for (const std::string& ending : format.endings) {
      if (HasEnding(std::string(name), ending)) {
        name.remove_suffix(ending.size());
      }
    }
  }
  return std::string(!name.empty() ? name : !whole.empty() ? whole : "volume");
}

absl::Status CheckAxes(const Format& format, const std::string& path, const std::string& axes,
                       absl::Span<const Format> formats) {
  const bool takes_them =
      !format.axes_for.empty() && (format.only_axes.empty() || format.only_axes == axes);
  if (axes.empty() || takes_them) {
    return absl::OkStatus();
  }
  std::vector<std::string> uses;
  for (const Format& other : formats) {
    if (!other.axes_for.empty()) {
      uses.push_back(absl::StrCat(
          other.only_axes.empty() ? "" : absl::StrCat("as --axes ", other.only_axes, " "), "for ",
          other.axes_for));
    }
  }
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": --axes ", axes, ": the axes of this kind of file have their meaning; --axes is ",
      absl::StrJoin(uses, ", ")));
}

}  // namespace isoscope::source
