#include "core/formats/dicom/dicom_steps.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <map>
#include <optional>
#include <utility>

#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

using Group = std::vector<DicomSlice>;  // of one place

enum class KeyTimes { kStepNumbers, kMilliseconds, kSecondsFromFirst };

struct MomentKey {
  std::optional<double> DicomMoment::*member;
  KeyTimes times;
};
constexpr std::array<MomentKey, 8> kMomentKeys{
    {{&DicomMoment::temporal_position, KeyTimes::kStepNumbers},
     {&DicomMoment::echo_time, KeyTimes::kMilliseconds},
     {&DicomMoment::trigger_time, KeyTimes::kMilliseconds},
     {&DicomMoment::dimension_rank, KeyTimes::kStepNumbers},
     {&DicomMoment::acquisition_number, KeyTimes::kStepNumbers},
     {&DicomMoment::acquisition_time, KeyTimes::kSecondsFromFirst},
     {&DicomMoment::content_time, KeyTimes::kSecondsFromFirst},
     {&DicomMoment::instance_number, KeyTimes::kStepNumbers}}};

// Slices at one position along the normal, and beside it, are a group.
std::vector<Group> GroupByPlace(std::vector<DicomSlice> slices) {
  std::stable_sort(slices.begin(), slices.end(), [](const DicomSlice& a, const DicomSlice& b) {
    return a.position < b.position;
  });
  std::vector<Group> groups;
  for (DicomSlice& slice : slices) {
    const double tolerance = 1e-3 * std::min(slice.spacing.x, slice.spacing.y);
    if (groups.empty() ||
        !(math::Length(slice.origin - groups.back().front().origin) <= tolerance)) {
      groups.emplace_back();
    }
    groups.back().push_back(std::move(slice));
  }
  return groups;
}

bool SortsGroup(const MomentKey& key, Group* group) {
  for (const DicomSlice& slice : *group) {
    if (!(slice.moment.*key.member).has_value()) {
      return false;
    }
  }
  std::stable_sort(group->begin(), group->end(), [&](const DicomSlice& a, const DicomSlice& b) {
    return *(a.moment.*key.member) < *(b.moment.*key.member);
  });
  return std::adjacent_find(group->begin(), group->end(),
                            [&](const DicomSlice& a, const DicomSlice& b) {
                              return *(a.moment.*key.member) == *(b.moment.*key.member);
                            }) == group->end();
}

// Times of the steps, from the sorted images of the first place.
void SetTimes(const MomentKey& key, const Group& group, DicomSteps* result) {
  const std::optional<double> resolution = group.front().moment.temporal_resolution;
  const bool has_resolution = resolution.has_value() && *resolution > 0;
  for (std::size_t step = 0; step < group.size(); ++step) {
    const double value = *(group[step].moment.*key.member);
    switch (key.times) {
      case KeyTimes::kStepNumbers:
        result->times.push_back(static_cast<double>(step) * (has_resolution ? *resolution : 1));
        break;
      case KeyTimes::kMilliseconds:
        result->times.push_back(value);
        break;
      case KeyTimes::kSecondsFromFirst:
        result->times.push_back(value - *(group.front().moment.*key.member));
        break;
    }
  }
  result->time_unit = key.times == KeyTimes::kSecondsFromFirst                 ? "s"
                      : key.times == KeyTimes::kMilliseconds || has_resolution ? "ms"
                                                                               : "";
}

}  // namespace

absl::StatusOr<DicomSteps> SplitDicomSteps(std::vector<DicomSlice> slices,
                                           const std::string& name) {
  std::vector<Group> groups = GroupByPlace(std::move(slices));
  std::map<std::size_t, std::size_t> sizes;  // groups by the number of their images
  for (const Group& group : groups) {
    ++sizes[group.size()];
  }
  const auto usual = std::max_element(
      sizes.begin(), sizes.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  const std::size_t step_count = sizes.empty() ? 0 : usual->first;
  if (sizes.size() > 1 && step_count > 1) {
    const auto other = std::find_if(groups.begin(), groups.end(),
                                    [&](const Group& group) { return group.size() != step_count; });
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d of %d places have %d images, a series of steps, but that of %s has %d: an image is "
        "missing, or there twice",
        name, usual->second, groups.size(), step_count, other->front().path, other->size()));
  }
  DicomSteps result;
  if (step_count <= 1) {
    std::vector<DicomSlice>& only = result.steps.emplace_back();
    for (Group& group : groups) {
      std::move(group.begin(), group.end(), std::back_inserter(only));
    }
    return result;
  }
  for (const MomentKey& key : kMomentKeys) {
    if (!std::all_of(groups.begin(), groups.end(),
                     [&key](Group& group) { return SortsGroup(key, &group); })) {
      continue;
    }
    SetTimes(key, groups.front(), &result);
    result.steps.resize(step_count);
    for (Group& group : groups) {
      for (std::size_t step = 0; step < step_count; ++step) {
        result.steps[step].push_back(std::move(group[step]));
      }
    }
    return result;
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: %d images at each of %d places, which nothing tells apart (no temporal position, echo "
      "or "
      "trigger time, acquisition or instance number): expected slices at one distance (each is "
      "there twice)",
      name, step_count, groups.size()));
}

}  // namespace isoscope::source
