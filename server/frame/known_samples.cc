// The histogram of a volume proves some surfaces empty. NoteOf returns the first note that applies:
//
//   every sample is NaN                            NO_SAMPLES
//   the isovalue is not in (smallest, largest]     OUTSIDE_RANGE
//   no label of the surface has a sample           NO_LABEL
//   some labels of the surface have no sample      SOME_LABELS_MISSING
//
// NoCellNoteOf is for a surface that passes all of these, but has no cell (NO_CELL). An empty bin
// proves that a label has no sample. A bin wider than one value proves nothing else, so MayHave
// says yes. TextOfValues shortens runs of three or more: 0, 1, 2, 3, 7 is "0 to 3, 7".

#include "server/frame/known_samples.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/volume/scalar_span.h"

namespace isoscope::server {
namespace {

using ProtoNote = isoscope::v1::SurfaceNote;

// A sentence lists at most this many labels, or ranges of labels.
constexpr std::size_t kMaxListed = 12;

std::string NumberText(double value) { return absl::StrFormat("%.9g", value); }

// Returns true if a sample of this type can have the value.
bool IsValueOf(volume::ScalarType type, double value) {
  return volume::VisitScalarType(type, [&]<typename T>() {
    const volume::Threshold<T> next = volume::InsideThreshold<T>(value);
    return next.any && static_cast<double>(next.value) == value;
  });
}

// "0 to 3, 7": whole numbers, ascending.
std::string TextOfValues(const std::vector<std::int64_t>& values) {
  std::vector<std::string> parts;
  std::size_t listed = 0;
  for (std::size_t begin = 0; begin < values.size() && parts.size() < kMaxListed;) {
    std::size_t end = begin + 1;
    while (end < values.size() && values[end] == values[end - 1] + 1) {
      ++end;
    }
    parts.push_back(end - begin < 3
                        ? absl::StrJoin(values.begin() + static_cast<std::ptrdiff_t>(begin),
                                        values.begin() + static_cast<std::ptrdiff_t>(end), ", ")
                        : absl::StrCat(values[begin], " to ", values[end - 1]));
    begin = listed = end;
  }
  return absl::StrCat(
      absl::StrJoin(parts, ", "),
      listed < values.size() ? absl::StrCat(" and ", values.size() - listed, " more") : "");
}

}  // namespace

KnownSamples::KnownSamples(volume::ScalarType type, volume::HistogramPart histogram,
                           std::vector<volume::Label> labels, std::string when)
    : type_(type),
      histogram_(std::move(histogram)),
      labels_(std::move(labels)),
      when_(std::move(when)) {}

bool KnownSamples::MayBeFinite() const {
  const volume::ScalarSpan& range = histogram_.value_range;
  return !(std::isinf(range.min) && range.min == range.max);
}

bool KnownSamples::MayHave(double value) const {
  const volume::ScalarSpan& range = histogram_.value_range;
  if (!(range.min <= value && value <= range.max) || !IsValueOf(type_, value)) {
    return false;
  }
  if (!histogram_.samples.has_value()) {
    return true;
  }
  const volume::HistogramBins& bins = histogram_.samples->bins;
  // Infinite samples may widen the range beyond the bins.
  if (bins.count == 0 || value < bins.EdgeOf(0) || value >= bins.EdgeOf(bins.count)) {
    return false;
  }
  return histogram_.samples->counts[static_cast<std::size_t>(bins.IndexOf(value))] > 0;
}

std::string KnownSamples::TextOfRange() const {
  if (!MayBeFinite()) {
    return absl::StrCat("no sample of the volume", when_, " is finite");
  }
  return absl::StrCat("the values of the volume", when_, " are in [",
                      NumberText(histogram_.value_range.min), ", ",
                      NumberText(histogram_.value_range.max), "]");
}

std::string KnownSamples::TextOfSamples() const {
  const bool is_integer =
      volume::VisitScalarType(type_, []<typename T>() { return std::is_integral_v<T>; });
  if (!is_integer || !histogram_.samples.has_value() || histogram_.samples->bins.exponent != 0) {
    return TextOfRange();
  }
  std::vector<std::int64_t> values;
  for (std::size_t i = 0; i < histogram_.samples->counts.size(); ++i) {
    if (histogram_.samples->counts[i] > 0) {
      values.push_back(histogram_.samples->bins.first + static_cast<std::int64_t>(i));
    }
  }
  return absl::StrCat("the samples", when_, " are ", TextOfValues(values));
}

std::string KnownSamples::NamesOf(const std::vector<double>& labels) const {
  std::vector<std::string> parts;
  for (std::size_t i = 0; i < labels.size() && i < kMaxListed; ++i) {
    const auto found = std::find_if(labels_.begin(), labels_.end(), [&](const volume::Label& one) {
      return one.value == labels[i];
    });
    const bool has_name = found != labels_.end() && !found->name.empty();
    parts.push_back(
        absl::StrCat(NumberText(labels[i]), has_name ? absl::StrCat(" (", found->name, ")") : ""));
  }
  return absl::StrCat(
      absl::StrJoin(parts, ", "),
      labels.size() > kMaxListed ? absl::StrCat(" and ", labels.size() - kMaxListed, " more") : "");
}

std::string KnownSamples::NameOf(const volume::InsideRule& rule) const {
  return rule.has_labels()
             ? absl::StrCat(rule.labels.size() == 1 ? "label " : "labels ", NamesOf(rule.labels))
             : absl::StrCat("isovalue ", NumberText(rule.isovalue));
}

std::optional<KnownSamples::Note> KnownSamples::NoteOf(const volume::InsideRule& rule) const {
  const std::string none =
      absl::StrCat(NameOf(rule), rule.labels.size() > 1 ? " have" : " has", " no surface: ");
  const volume::ScalarSpan& range = histogram_.value_range;
  if (!(range.min <= range.max)) {
    return Note(ProtoNote::REASON_NO_SAMPLES,
                absl::StrCat(none, "every sample of the volume", when_, " is NaN"));
  }
  if (!rule.has_labels()) {
    // A sample equal to the isovalue is inside: at the smallest one all samples are.
    return volume::IsActive(range, rule.isovalue)
               ? std::nullopt
               : std::optional(Note(
                     ProtoNote::REASON_OUTSIDE_RANGE,
                     absl::StrCat(none, TextOfRange(),
                                  MayBeFinite() ? ", and it must be above the smallest and at most "
                                                  "the largest"
                                                : "")));
  }
  std::vector<double> missing;
  for (const double label : rule.labels) {
    if (!MayHave(label)) {
      missing.push_back(label);
    }
  }
  if (missing.empty()) {
    return std::nullopt;
  }
  if (missing.size() == rule.labels.size()) {
    return Note(ProtoNote::REASON_NO_LABEL,
                absl::StrCat(none, "no sample has ", missing.size() == 1 ? "it" : "one of them",
                             "; ", TextOfSamples()));
  }
  return Note(ProtoNote::REASON_SOME_LABELS_MISSING,
              absl::StrCat("no sample has ", missing.size() == 1 ? "label " : "labels ",
                           NamesOf(missing), " of ", NamesOf(rule.labels), "; ", TextOfSamples()));
}

KnownSamples::Note KnownSamples::NoCellNoteOf(const volume::InsideRule& rule, int level) const {
  const std::string none =
      absl::StrCat(NameOf(rule), rule.labels.size() > 1 ? " have" : " has", " no surface: ");
  if (level > 0) {
    return {ProtoNote::REASON_NO_CELL,
            absl::StrCat(none, "no cell of level ", level,
                         " has a sample inside and one outside; what is thinner than its samples "
                         "may show at level 0")};
  }
  if (rule.has_labels()) {
    return {ProtoNote::REASON_NO_CELL,
            absl::StrCat(none, "no cell has a sample inside and one outside; ", TextOfSamples())};
  }
  return {ProtoNote::REASON_NO_CELL,
          absl::StrCat(none, TextOfRange(),
                       ", but no cell has samples on both sides of it: missing ones (NaN) lie "
                       "between them")};
}

}  // namespace isoscope::server
