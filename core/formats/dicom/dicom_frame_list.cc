// An element may stand in several places. The later one of these counts, for each frame:
//
//   the data set                              all frames
//   DetectorInformationSequence (0054,0022)   frames of that detector, of nuclear medicine
//   shared functional groups (5200,9229)      all frames
//   functional groups (5200,9230)             one frame
//
// An element that is there, but broken, hides those before it: it is never replaced in silence.
//
// Frames of nuclear medicine have indices in vectors, as many numbers as frames; the tags of these
// vectors stand in FrameIncrementPointer (0028,0009). Frames with functional groups have indices of
// their own (0020,9157), in the order of DimensionIndexSequence (0020,9222).

#include "core/formats/dicom/dicom_frame_list.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

#include "core/base/coding.h"

namespace isoscope::source {
namespace {

constexpr std::uint32_t kSharedGroups = 0x52009229;
constexpr std::uint32_t kFrameGroups = 0x52009230;
constexpr std::uint32_t kFrameContent = 0x00209111;
constexpr std::uint32_t kValueGroup = 0x00289145;  // of slope and intercept
constexpr std::uint32_t kSliceVector = 0x00540080;
constexpr std::uint32_t kDetectorVector = 0x00540020;
constexpr std::uint32_t kOffsets = 0x3004000c;

gdcm::Tag TagOf(std::uint32_t tag) {
  return {static_cast<std::uint16_t>(tag >> 16), static_cast<std::uint16_t>(tag & 0xffff)};
}

// Text without the spaces and zeros that fill it up.
absl::string_view Trimmed(absl::string_view text) {
  const std::size_t last = text.find_last_not_of(absl::string_view(" \0", 2));
  return absl::StripAsciiWhitespace(text.substr(0, last == text.npos ? 0 : last + 1));
}

// Reads numbers that are text (DS, IS). If they are not given: kMissing or kBroken, and no numbers.
DicomGiven TextNumbers(const gdcm::DataSet& data, const gdcm::Tag& tag,
                       std::vector<double>* numbers) {
  const std::string bytes = DicomBytesOf(data, tag);
  const absl::string_view text = Trimmed(bytes);
  if (text.empty()) {
    return DicomGiven::kMissing;
  }
  for (const absl::string_view word : absl::StrSplit(text, '\\')) {
    double number = 0;
    if (!absl::SimpleAtod(Trimmed(word), &number) || !std::isfinite(number)) {
      numbers->clear();
      return DicomGiven::kBroken;
    }
    numbers->push_back(number);
  }
  return DicomGiven::kGiven;
}

// Keeps the numbers of an element, unless it is missing.
template <std::size_t kCount>
void Keep(const gdcm::DataSet& data, const gdcm::Tag& tag, DicomNumbers<kCount>* kept) {
  std::vector<double> numbers;
  const DicomGiven given = TextNumbers(data, tag, &numbers);
  if (given == DicomGiven::kMissing) {
    return;
  }
  *kept = {.given = DicomGiven::kBroken};
  if (given == DicomGiven::kGiven && numbers.size() == kCount) {
    std::copy(numbers.begin(), numbers.end(), kept->values.begin());
    kept->given = DicomGiven::kGiven;
  }
}

// Binary numbers (AT, FD, UL, US).
template <typename T>
std::vector<T> BinaryNumbers(const gdcm::DataSet& data, const gdcm::Tag& tag) {
  const std::string bytes = DicomBytesOf(data, tag);
  std::vector<T> numbers(bytes.size() / sizeof(T));
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    numbers[i] = base::LoadLittleEndian<T>(bytes.data() + i * sizeof(T));
  }
  return numbers;
}

template <typename T>
MaybeDicomNumber BinaryNumber(const gdcm::DataSet& data, const gdcm::Tag& tag) {
  const std::vector<T> numbers = BinaryNumbers<T>(data, tag);
  if (numbers.size() != 1 || !std::isfinite(static_cast<double>(numbers[0]))) {
    return {};
  }
  return {.value = static_cast<double>(numbers[0]), .is_set = 1};
}

// Keeps the binary numbers (FD) of an element, unless it is missing.
template <std::size_t kCount>
void KeepBinary(const gdcm::DataSet& data, const gdcm::Tag& tag, DicomNumbers<kCount>* kept) {
  const std::vector<double> numbers = BinaryNumbers<double>(data, tag);
  if (numbers.empty()) {
    return;
  }
  *kept = {.given = DicomGiven::kBroken};
  if (numbers.size() == kCount &&
      std::all_of(numbers.begin(), numbers.end(), [](double n) { return std::isfinite(n); })) {
    std::copy(numbers.begin(), numbers.end(), kept->values.begin());
    kept->given = DicomGiven::kGiven;
  }
}

// Tags, each a group and an element. Those beyond kMaxDicomDimensions are left out.
DicomTags TagsOf(const gdcm::DataSet& data, const gdcm::Tag& tag) {
  const std::vector<std::uint16_t> numbers = BinaryNumbers<std::uint16_t>(data, tag);
  DicomTags tags{};
  for (std::size_t i = 0; i < tags.size() && 2 * i + 1 < numbers.size(); ++i) {
    tags[i] = std::uint32_t{numbers[2 * i]} << 16 | numbers[2 * i + 1];
  }
  return tags;
}

// Calls `use` with the first item of a sequence if it is there.
template <typename Use>
void UseItem(const gdcm::DataSet& data, const gdcm::Tag& tag, const Use& use) {
  const gdcm::SmartPointer<gdcm::SequenceOfItems> items = DicomItemsOf(data, tag);
  if (items != nullptr && items->GetNumberOfItems() > 0) {
    use(items->GetItem(1).GetNestedDataSet());
  }
}

// The things that a data set says of a frame: that of a file, or an item of functional groups.
void FillPlane(const gdcm::DataSet& data, DicomFrameRecord* frame) {
  Keep(data, {0x0020, 0x0032}, &frame->position);
  Keep(data, {0x0020, 0x0037}, &frame->orientation);
  KeepBinary(data, {0x0020, 0x9301}, &frame->position);  // of ultrasound volumes
  KeepBinary(data, {0x0020, 0x9302}, &frame->orientation);
  Keep(data, {0x0028, 0x0030}, &frame->pixel_spacing);
  Keep(data, {0x0018, 0x0088}, &frame->slice_spacing);
  Keep(data, {0x0028, 0x1053}, &frame->slope);
  Keep(data, {0x0028, 0x1052}, &frame->intercept);
}

// The indices of a frame, if it has one of each dimension.
void FillIndices(const gdcm::DataSet& content, const DicomTags& dimensions,
                 DicomFrameRecord* frame) {
  const auto count = static_cast<std::size_t>(std::find(dimensions.begin(), dimensions.end(), 0U) -
                                              dimensions.begin());
  const std::vector<std::uint32_t> indices =
      BinaryNumbers<std::uint32_t>(content, {0x0020, 0x9157});
  if (indices.size() == count) {
    std::copy(indices.begin(), indices.end(), frame->indices.begin());
  }
}

// Functional groups, of all frames or of one.
void FillGroups(const gdcm::DataSet& groups, const DicomTags& dimensions, DicomFrameRecord* frame) {
  const auto plane = [frame](const gdcm::DataSet& data) { FillPlane(data, frame); };
  for (const gdcm::Tag& tag :
       {gdcm::Tag(0x0020, 0x9113), gdcm::Tag(0x0020, 0x9116), gdcm::Tag(0x0020, 0x930e),
        gdcm::Tag(0x0020, 0x930f), gdcm::Tag(0x0028, 0x9110),
        TagOf(kValueGroup)}) {  // position, orientation, both again, measures, values
    UseItem(groups, tag, plane);
  }
  const auto keep = [](const MaybeDicomNumber& found, MaybeDicomNumber* number) {
    *number = found.is_set == 1 ? found : *number;
  };
  UseItem(groups, TagOf(kFrameContent), [&](const gdcm::DataSet& content) {
    keep(BinaryNumber<std::uint32_t>(content, {0x0020, 0x9128}), &frame->temporal_position);
    FillIndices(content, dimensions, frame);
  });
  UseItem(groups, {0x0018, 0x9114}, [&](const gdcm::DataSet& echo) {
    keep(BinaryNumber<double>(echo, {0x0018, 0x9082}), &frame->echo_time);
  });
  UseItem(groups, {0x0018, 0x9118}, [&](const gdcm::DataSet& cardiac) {
    keep(BinaryNumber<double>(cardiac, {0x0020, 0x9153}), &frame->trigger_time);
  });
  UseItem(groups, {0x0062, 0x000a}, [&](const gdcm::DataSet& identification) {
    const auto number = BinaryNumber<std::uint16_t>(identification, {0x0062, 0x000b});
    frame->segment = number.is_set == 1 ? static_cast<std::uint64_t>(number.value) : frame->segment;
  });
}

DicomPhotometric PhotometricOf(const gdcm::DataSet& data) {
  const std::string bytes = DicomBytesOf(data, {0x0028, 0x0004});
  const absl::string_view text = Trimmed(bytes);
  return text.empty()                                      ? DicomPhotometric::kMissing
         : text == "MONOCHROME1" || text == "MONOCHROME2"  ? DicomPhotometric::kMonochrome
         : absl::StartsWith(text, "PALETTE")               ? DicomPhotometric::kPalette
         : text == "RGB" || absl::StartsWith(text, "YBR_") ? DicomPhotometric::kColour
                                                           : DicomPhotometric::kOther;
}

DicomSegmentKind SegmentKindOf(const gdcm::DataSet& data) {
  const std::string bytes = DicomBytesOf(data, {0x0062, 0x0001});
  const absl::string_view text = Trimmed(bytes);
  return text == "BINARY"       ? DicomSegmentKind::kBinary
         : text == "FRACTIONAL" ? DicomSegmentKind::kFractional
         : text == "LABELMAP"   ? DicomSegmentKind::kLabelMap
                                : DicomSegmentKind::kUnknown;
}

// The dimensions of functional groups, without those beyond kMaxDicomDimensions.
DicomTags GroupDimensions(const gdcm::DataSet& data) {
  DicomTags tags{};
  const gdcm::SmartPointer<gdcm::SequenceOfItems> items = DicomItemsOf(data, {0x0020, 0x9222});
  const std::size_t count = items == nullptr ? 0 : items->GetNumberOfItems();
  for (std::size_t i = 0; i < std::min(count, tags.size()); ++i) {
    tags[i] = TagsOf(items->GetItem(i + 1).GetNestedDataSet(), {0x0020, 0x9165})[0];
  }
  return count <= tags.size() ? tags : DicomTags{};
}

// The vectors of nuclear medicine.
class FrameVectors {
 public:
  // Those that tell frames apart; slices have one in any case.
  FrameVectors(const gdcm::DataSet& data, const DicomTags& increments, std::size_t frames) {
    constexpr std::uint16_t kGroup = 0x0054;
    DicomTags tags = increments;
    const auto end = std::find(tags.begin(), tags.end(), 0U);
    const std::uint32_t slices = kSliceVector;
    if (end != tags.end() && std::find(tags.begin(), end, slices) == end) {
      *end = slices;
    }
    for (const std::uint32_t tag : tags) {
      if (TagOf(tag).GetGroup() != kGroup) {
        continue;
      }
      const auto numbers = BinaryNumbers<std::uint16_t>(data, TagOf(tag));
      if (numbers.size() == frames) {
        dimensions_[vectors_.size()] = tag;
        vectors_.push_back(numbers);
      }
    }
    detectors_ = BinaryNumbers<std::uint16_t>(data, TagOf(kDetectorVector));
    if (detectors_.size() != frames) {
      detectors_.assign(frames, 1);
    }
  }

  [[nodiscard]] const DicomTags& dimensions() const { return dimensions_; }
  // Detectors count from 1 on, in a file that keeps to the standard.
  [[nodiscard]] std::size_t DetectorOf(std::size_t frame) const { return detectors_[frame]; }
  void FillIndices(std::size_t index, DicomFrameRecord* frame) const {
    for (std::size_t i = 0; i < vectors_.size(); ++i) {
      frame->indices[i] = vectors_[i][index];
    }
  }

 private:
  DicomTags dimensions_{};
  std::vector<std::vector<std::uint16_t>> vectors_;
  std::vector<std::uint16_t> detectors_;
};

void FillAnswer(const gdcm::DataSet& data, std::size_t count, DicomAnswer* answer) {
  const auto number = [&data](std::uint16_t element) {
    return static_cast<std::uint32_t>(DicomShortOf(data, gdcm::Tag(0x0028, element)).value);
  };
  answer->dims = {number(0x0011), number(0x0010), count};
  answer->components = std::max(number(0x0002), 1U);
  answer->bits_allocated = number(0x0100);
  answer->bits_stored = number(0x0101);
  answer->high_bit = number(0x0102);
  answer->is_signed = number(0x0103) == 1 ? 1 : 0;
  answer->photometric = PhotometricOf(data);
  UseItem(data, {0x0028, 0x3000}, [answer](const gdcm::DataSet&) { answer->has_lut = 1; });
  Keep(data, {0x0018, 0x1164}, &answer->imager_spacing);
  Keep(data, {0x0018, 0x2010}, &answer->scanned_spacing);
  Keep(data, {0x3004, 0x000e}, &answer->dose_scaling);
  answer->increments = TagsOf(data, {0x0028, 0x0009});
  answer->segment_kind = SegmentKindOf(data);
  answer->padding = DicomShortOf(data, {0x0028, 0x0120});
  const std::string series = DicomBytesOf(data, {0x0020, 0x000e});
  std::copy_n(series.data(), std::min(series.size(), kMaxDicomUidBytes), answer->series.data());
}

// A frame of each detector, from 1 on; the first one is that of frames without a detector.
std::vector<DicomFrameRecord> CommonFrames(const gdcm::DataSet& data, const DicomTags& dimensions) {
  std::vector<DicomFrameRecord> frames(1);
  FillPlane(data, frames.data());
  UseItem(data, TagOf(kSharedGroups), [&](const gdcm::DataSet& shared_groups) {
    FillGroups(shared_groups, dimensions, frames.data());
  });
  const gdcm::SmartPointer<gdcm::SequenceOfItems> items = DicomItemsOf(data, {0x0054, 0x0022});
  const std::size_t count = items == nullptr ? 0 : items->GetNumberOfItems();
  for (std::size_t i = 1; i <= std::min(count, kMaxDicomFrames); ++i) {
    frames.push_back(frames.front());
    FillPlane(items->GetItem(i).GetNestedDataSet(), &frames.back());
  }
  return frames;
}

}  // namespace

std::string DicomBytesOf(const gdcm::DataSet& data, const gdcm::Tag& tag) {
  if (!data.FindDataElement(tag)) {
    return "";
  }
  const gdcm::ByteValue* const bytes = data.GetDataElement(tag).GetByteValue();
  return bytes == nullptr ? "" : std::string(bytes->GetPointer(), bytes->GetLength());
}

MaybeDicomNumber DicomShortOf(const gdcm::DataSet& data, const gdcm::Tag& tag) {
  return BinaryNumber<std::uint16_t>(data, tag);
}

gdcm::SmartPointer<gdcm::SequenceOfItems> DicomItemsOf(const gdcm::DataSet& data,
                                                       const gdcm::Tag& tag) {
  // Implicit ones are parsed at each call.
  return data.FindDataElement(tag) ? data.GetDataElement(tag).GetValueAsSQ()
                                   : gdcm::SmartPointer<gdcm::SequenceOfItems>();
}

void ListDicomFrames(const gdcm::DataSet& data, std::size_t count, DicomAnswer* answer,
                     char* shared) {
  FillAnswer(data, count, answer);
  const gdcm::SmartPointer<gdcm::SequenceOfItems> groups = DicomItemsOf(data, TagOf(kFrameGroups));
  answer->group_items = groups == nullptr ? 0 : groups->GetNumberOfItems();
  const FrameVectors vectors(data, answer->increments, count);
  const DicomTags group_dimensions = GroupDimensions(data);
  answer->dimensions = answer->group_items > 0 ? group_dimensions : vectors.dimensions();

  std::vector<double> offsets;
  answer->offsets = TextNumbers(data, TagOf(kOffsets), &offsets);
  if (answer->offsets == DicomGiven::kGiven && offsets.size() != count) {
    answer->offsets = DicomGiven::kBroken;
  }
  const std::vector<DicomFrameRecord> common = CommonFrames(data, group_dimensions);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t detector = vectors.DetectorOf(i);
    DicomFrameRecord frame = common[detector < common.size() ? detector : 0];
    if (i < answer->group_items) {
      const gdcm::DataSet& own = groups->GetItem(i + 1).GetNestedDataSet();
      FillGroups(own, group_dimensions, &frame);
      UseItem(own, TagOf(kValueGroup),
              [&frame](const gdcm::DataSet&) { frame.has_own_values = 1; });
    } else {
      vectors.FillIndices(i, &frame);
    }
    frame.offset = answer->offsets == DicomGiven::kGiven ? offsets[i] : 0;
    std::memcpy(shared + i * sizeof(frame), &frame, sizeof(frame));
  }
}

}  // namespace isoscope::source
