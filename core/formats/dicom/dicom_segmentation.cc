// A segmentation is a file of frames. Each has a place, as those of an image, and in BINARY and
// FRACTIONAL ones a segment (0062,000b). Frames without a pixel of their segment are mostly left
// out:
//
//   place     frames            plane
//   10        segment 1, 2      1 1 2 .
//   12.5      segment 2         . 2 2 .
//   15        none              . . . .     the place is made up
//   17.5      segment 1         1 . . .
//
// BINARY frames have one bit a pixel, without gaps between frames: frame f begins at bit
// f * columns * rows. These bits, and other pixels that are not compressed, are read from the file
// itself: DicomScan knows where they lie.
//
// Sources: DICOM PS3.3, sections A.51 and C.8.20; PS3.5, section 8.1.1 and annex D.

#include "core/formats/dicom/dicom_segmentation.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/formats/dicom/dicom_decoder.h"
#include "core/formats/dicom/dicom_geometry.h"
#include "core/formats/dicom/dicom_module.h"
#include "core/formats/dicom/dicom_stack.h"
#include "core/formats/dicom/dicom_steps.h"
#include "core/formats/dicom/segment_bits.h"
#include "core/formats/dicom/segment_places.h"
#include "core/io/file.h"
#include "core/math/vec.h"
#include "core/source/adapt/slice_source.h"
#include "core/volume/label.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {
namespace {

using volume::ScalarType;

struct Segmentation {
  std::string path;
  std::int64_t pixels_offset = -1;  // -1: compressed
  DicomFrames frames;

  [[nodiscard]] bool is_binary() const { return frames.segment_kind == DicomSegmentKind::kBinary; }
  [[nodiscard]] std::int64_t pixels() const { return frames.pixels.width * frames.pixels.height; }
  [[nodiscard]] const DicomFrame& frame(std::size_t i) const { return frames.frames[i]; }
};

// A frame in a plane, and the value of its pixels in BINARY ones.
struct PlaneFrame {
  std::size_t frame = 0;
  std::int64_t segment = 0;
};
// The frames of a layer, by plane. Planes without a frame are absent, so that many layers of many
// planes are small.
using LayerFrames = std::map<std::int64_t, std::vector<PlaneFrame>>;

template <typename T>
void WriteWhereSet(const SegmentWords& words, std::int64_t count, T value, char* out) {
  for (std::int64_t i = 0; i < count; ++i) {
    if ((words[static_cast<std::size_t>(i / 64)] >> (i % 64) & 1) != 0) {
      base::StoreLittleEndian(value, out + i * static_cast<std::int64_t>(sizeof(T)));
    }
  }
}

class SegmentPlanes final : public SliceReader {
 public:
  SegmentPlanes(std::shared_ptr<const Segmentation> segmentation, ScalarType type,
                LayerFrames frames)
      : segmentation_(std::move(segmentation)),
        type_(type),
        frames_(std::move(frames)),
        bytes_(segmentation_->pixels() * static_cast<std::int64_t>(volume::SizeOf(type))),
        decoder_(bytes_) {}

  absl::Status Start() {
    if (segmentation_->pixels_offset < 0) {
      return decoder_.Start();
    }
    ISOSCOPE_ASSIGN_OR_RETURN(file_, io::OpenRandomAccessFile(segmentation_->path));
    return absl::OkStatus();
  }

  [[nodiscard]] std::int64_t memory_bytes() const override { return kDicomModuleBytes; }
  absl::Status ReadSlice(std::int64_t z, char* out) override {
    FillEmpty(out);
    const auto here = frames_.find(z);
    if (here == frames_.end()) {
      return absl::OkStatus();
    }
    for (const PlaneFrame& frame : here->second) {
      ISOSCOPE_RETURN_IF_ERROR(segmentation_->is_binary() ? ReadBits(frame, out)
                                                          : ReadPixels(frame, out));
    }
    return absl::OkStatus();
  }

 private:
  // The padding value stands in pixels of no segment of a label map, so it does in whole planes.
  void FillEmpty(char* out) const {
    const DicomFrames& frames = segmentation_->frames;
    const bool has_padding =
        frames.segment_kind == DicomSegmentKind::kLabelMap && frames.padding.has_value();
    const double largest = type_ == ScalarType::kUint8 ? 255 : 65535;
    const double padding = has_padding ? std::clamp(*frames.padding, 0.0, largest) : 0;
    if (type_ == ScalarType::kUint8) {
      std::fill_n(out, bytes_, static_cast<char>(static_cast<std::uint8_t>(padding)));
      return;
    }
    for (std::int64_t i = 0; i < segmentation_->pixels(); ++i) {
      base::StoreLittleEndian(static_cast<std::uint16_t>(padding), out + 2 * i);
    }
  }

  absl::Status ReadBits(const PlaneFrame& frame, char* out) {
    const std::int64_t pixels = segmentation_->pixels();
    ISOSCOPE_RETURN_IF_ERROR(ReadSegmentBits(*file_, segmentation_->pixels_offset,
                                             static_cast<std::int64_t>(frame.frame) * pixels,
                                             pixels, &words_));
    if (type_ == ScalarType::kUint8) {
      WriteWhereSet(words_, pixels, static_cast<std::uint8_t>(frame.segment), out);
    } else {
      WriteWhereSet(words_, pixels, static_cast<std::uint16_t>(frame.segment), out);
    }
    return absl::OkStatus();
  }

  absl::Status ReadPixels(const PlaneFrame& frame, char* out) {
    const auto number = static_cast<std::int64_t>(frame.frame);
    if (segmentation_->pixels_offset >= 0) {
      return file_->ReadAt(segmentation_->pixels_offset + number * bytes_,
                           static_cast<std::size_t>(bytes_), out);
    }
    const absl::Status decoded =
        decoder_.ReadFrame(segmentation_->path, false, number, segmentation_->frames.pixels, out);
    if (!decoded.ok() && !absl::IsDataLoss(decoded)) {
      return absl::Status(decoded.code(),
                          absl::StrCat(segmentation_->path, ": ", decoded.message()));
    }
    return decoded.ok() ? decoded
                        : absl::Status(decoded.code(),
                                       absl::StrFormat("%s: frame %d can't be decoded: damaged, or "
                                                       "of an encoding that is not known here; "
                                                       "convert its pixels to uncompressed ones",
                                                       segmentation_->path, number));
  }

  const std::shared_ptr<const Segmentation> segmentation_;
  const ScalarType type_;
  const LayerFrames frames_;
  const std::int64_t bytes_;  // of a plane
  DicomDecoder decoder_;
  std::unique_ptr<io::RandomAccessFile> file_;
  SegmentWords words_;
};

class SegmentationSeries final : public VolumeSeries {
 public:
  SegmentationSeries(std::shared_ptr<const Segmentation> segmentation, ScalarType type,
                     const volume::GridGeometry& geometry, std::vector<SourceField> fields,
                     std::vector<LayerFrames> layers)
      : VolumeSeries(
            {.name = segmentation->path, .fields = std::move(fields), .length_unit = "mm"}),
        segmentation_(std::move(segmentation)),
        type_(type),
        geometry_(geometry),
        layers_(std::move(layers)) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int /*component*/,
                                                     int /*step*/) override {
    auto planes = std::make_unique<SegmentPlanes>(segmentation_, type_,
                                                  layers_[static_cast<std::size_t>(field)]);
    ISOSCOPE_RETURN_IF_ERROR(planes->Start());
    return MakeSliceSource({.name = info().name,
                            .geometry = geometry_,
                            .type = type_,
                            .patient_frame = volume::PatientFrame()},
                           std::move(planes));
  }

 private:
  const std::shared_ptr<const Segmentation> segmentation_;
  const ScalarType type_;
  const volume::GridGeometry geometry_;
  const std::vector<LayerFrames> layers_;  // by field
};

absl::Status CheckPixels(const Segmentation& segmentation) {
  const DicomFrames& frames = segmentation.frames;
  const std::int64_t bits = frames.pixels.bits_allocated;
  if (frames.segment_kind == DicomSegmentKind::kUnknown || frames.pixels.components != 1 ||
      segmentation.pixels() == 0 ||
      (segmentation.is_binary() ? bits != 1 : bits != 8 && bits != 16)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: a segmentation of %d x %d pixels of %d bits, %d samples a pixel, of %s type; expected "
        "BINARY of 1 bit, or FRACTIONAL or LABELMAP of 8 or 16 bits",
        segmentation.path, frames.pixels.width, frames.pixels.height, bits,
        frames.pixels.components,
        frames.segment_kind == DicomSegmentKind::kUnknown      ? "an unknown"
        : segmentation.is_binary()                             ? "BINARY"
        : frames.segment_kind == DicomSegmentKind::kFractional ? "FRACTIONAL"
                                                               : "LABELMAP"));
  }
  if (segmentation.is_binary() && segmentation.pixels_offset < 0) {
    return absl::InvalidArgumentError(
        absl::StrCat(segmentation.path,
                     ": a segmentation of 1 bit a pixel whose pixels are compressed, or whose "
                     "file is deflated or big-endian; convert it to Explicit VR Little Endian"));
  }
  return absl::OkStatus();
}

// The frames as slices; each has all that a volume needs, and its segment.
absl::StatusOr<std::vector<DicomSlice>> SlicesOf(const Segmentation& segmentation,
                                                 bool has_spacing) {
  const bool has_segments = segmentation.frames.segment_kind != DicomSegmentKind::kLabelMap;
  std::vector<DicomSlice> slices;
  for (std::size_t i = 0; i < segmentation.frames.frames.size(); ++i) {
    const DicomFrame& frame = segmentation.frame(i);
    const std::string name =
        absl::StrFormat("%s: frame %d of %d of the segmentation", segmentation.path, i,
                        segmentation.frames.frames.size());
    if (frame.position.is_missing()) {
      return absl::InvalidArgumentError(absl::StrCat(
          name, " has no position (0020,0032): no volume (those of slides are tiles of a plane)"));
    }
    if (has_segments && frame.segment == 0) {
      return absl::InvalidArgumentError(
          absl::StrCat(name, " has no number of a segment (0062,000b)"));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const DicomPlane plane,
                              PlaneOfDicomFrame(frame, name, {}, has_spacing));
    DicomSlice& slice = slices.emplace_back();
    slice.path = segmentation.path;
    slice.frame = static_cast<std::int64_t>(i);
    slice.width = segmentation.frames.pixels.width;
    slice.height = segmentation.frames.pixels.height;
    slice.origin = plane.origin;
    slice.spacing = plane.spacing;
    slice.direction = plane.direction;
    slice.position = plane.position;
  }
  return slices;
}

// Returns the distance of planes that the file names; 0 if it names none. INVALID_ARGUMENT: it is
// negative, or no number.
absl::StatusOr<double> NamedDistance(const Segmentation& segmentation) {
  const DicomNumbers<1>& spacing = segmentation.frame(0).slice_spacing;
  if (spacing.given == DicomGiven::kBroken || spacing.value() < 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: its spacing between slices (0018,0088) is %s; expected a number above 0",
        segmentation.path,
        spacing.is_given() ? absl::StrCat(spacing.value()) : "there, but is no number"));
  }
  return spacing.value();
}

// Finds the segments that overlap, by their indices.
absl::StatusOr<std::vector<std::size_t>> LayersOf(
    const Segmentation& segmentation, const SegmentPlaces& places,
    const std::map<std::int64_t, std::size_t>& index_of) {
  if (index_of.size() > SegmentOverlaps::kMaxSegments) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d segments of one bit; at most %d: convert it to a label map",
                        segmentation.path, index_of.size(), SegmentOverlaps::kMaxSegments));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(segmentation.path));
  SegmentOverlaps overlaps(index_of.size());
  constexpr std::int64_t kMaxBits = 16 * base::kMiB * 8;
  for (const std::vector<std::size_t>& frames : places.frames) {
    const std::int64_t step =
        std::max<std::int64_t>(64, kMaxBits / static_cast<std::int64_t>(frames.size()));
    for (std::int64_t first = 0; frames.size() > 1 && first < segmentation.pixels();
         first += step) {
      std::vector<SegmentOverlaps::Mask> masks;
      for (const std::size_t frame : frames) {
        SegmentOverlaps::Mask mask{.segment = index_of.at(segmentation.frame(frame).segment)};
        ISOSCOPE_RETURN_IF_ERROR(
            ReadSegmentBits(*file, segmentation.pixels_offset,
                            static_cast<std::int64_t>(frame) * segmentation.pixels() + first,
                            std::min(step, segmentation.pixels() - first), &mask.words));
        if (std::any_of(mask.words.begin(), mask.words.end(),
                        [](std::uint64_t word) { return word != 0; })) {
          masks.push_back(std::move(mask));
        }
      }
      overlaps.Add(masks);
    }
  }
  return overlaps.Layers();
}

// The numbers of segments, with their indices by number; one number 0 of a label map.
absl::StatusOr<std::map<std::int64_t, std::size_t>> IndexSegments(const Segmentation& segmentation,
                                                                  const SegmentPlaces& places) {
  std::map<std::int64_t, std::size_t> index_of;
  for (const std::vector<std::size_t>& frames : places.frames) {
    std::set<std::int64_t> here;
    for (const std::size_t frame : frames) {
      const bool is_map = segmentation.frames.segment_kind == DicomSegmentKind::kLabelMap;
      const std::int64_t segment = is_map ? 0 : segmentation.frame(frame).segment;
      if (!here.insert(segment).second) {
        return absl::InvalidArgumentError(
            is_map ? absl::StrFormat("%s: frame %d lies where another one does", segmentation.path,
                                     frame)
                   : absl::StrFormat("%s: frame %d of segment %d lies where another one of it does",
                                     segmentation.path, frame, segment));
      }
      index_of[segment] = 0;
    }
  }
  std::size_t index = 0;
  for (auto& [segment, its_index] : index_of) {
    its_index = index++;
  }
  return index_of;
}

// The fields of shares, one for each segment.
absl::StatusOr<std::vector<SourceField>> FieldsOfShares(
    const std::string& path, const std::map<std::int64_t, std::size_t>& index_of) {
  DicomDecoder decoder;
  std::map<std::int64_t, std::string> labels;
  if (const auto read = decoder.ReadSegments(path); read.ok()) {
    for (const DicomSegment& segment : read->segments) {
      labels[segment.number] = volume::CleanLabelName(segment.label);
    }
  } else if (!absl::IsDataLoss(read.status())) {  // the file may have names
    return absl::Status(read.status().code(), absl::StrCat(path, ": ", read.status().message()));
  }
  std::vector<SourceField> fields;
  std::set<std::string> names;
  for (const auto& [segment, index] : index_of) {
    std::string name = labels[segment];
    if (name.empty() || !names.insert(name).second) {
      name = absl::StrCat(name, name.empty() ? "" : " ", "segment ", segment);
      names.insert(name);
    }
    fields.push_back({.name = std::move(name)});
  }
  return fields;
}

absl::StatusOr<Segmentation> ReadSegmentation(const std::string& path, const DicomScan& scan) {
  DicomDecoder decoder;
  absl::StatusOr<DicomFrames> frames = decoder.ReadFrames(path);
  if (!frames.ok()) {
    return absl::IsDataLoss(frames.status())
               ? absl::InvalidArgumentError(absl::StrFormat(
                     "%s: can't be decoded as a DICOM segmentation (transfer syntax %s%s%s): "
                     "damaged, or of an encoding that is not known; convert it to Explicit VR "
                     "Little Endian",
                     path, scan.transfer_syntax,
                     frames.status().message().empty() ? "" : "; the process that decodes: ",
                     frames.status().message()))
               : absl::Status(frames.status().code(),
                              absl::StrCat(path, ": ", frames.status().message()));
  }
  Segmentation segmentation{.path = path,
                            .pixels_offset = scan.is_counted ? scan.pixels_offset : -1,
                            .frames = *std::move(frames)};
  // The file has the pixels that the scan counted, and memory for no more is taken.
  if (segmentation.pixels_offset >= 0 &&
      (segmentation.frames.pixels.width != scan.width ||
       segmentation.frames.pixels.height != scan.height ||
       segmentation.frames.pixels.bits_allocated != scan.bits_allocated ||
       static_cast<std::int64_t>(segmentation.frames.frames.size()) != scan.frames)) {
    return DicomCutError(path);
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckPixels(segmentation));
  return segmentation;
}

// The layer of each segment by its index.
absl::StatusOr<std::vector<std::size_t>> ChooseLayers(
    const Segmentation& segmentation, const SegmentPlaces& places,
    const std::map<std::int64_t, std::size_t>& index_of) {
  if (segmentation.is_binary()) {
    return LayersOf(segmentation, places, index_of);
  }
  std::vector<std::size_t> layers(index_of.size());
  std::iota(layers.begin(), layers.end(), std::size_t{0});
  return layers;
}

std::vector<SourceField> FieldsOfLayers(std::size_t count, const std::string& field) {
  std::vector<SourceField> fields;
  for (std::size_t i = 1; i <= count; ++i) {
    fields.push_back({.name = count == 1 ? field : absl::StrCat("layer ", i)});
  }
  return fields;
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenDicomSegmentation(const std::string& path,
                                                                    const DicomScan& scan,
                                                                    const std::string& field,
                                                                    const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(Segmentation read, ReadSegmentation(path, scan));
  const auto segmentation = std::make_shared<const Segmentation>(std::move(read));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<DicomSlice> frames,
                            SlicesOf(*segmentation, rules.has_spacing));
  ISOSCOPE_ASSIGN_OR_RETURN(const double distance, NamedDistance(*segmentation));
  ISOSCOPE_ASSIGN_OR_RETURN(const SegmentPlaces places, PlacesOfFrames(std::move(frames)));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<DicomSlice> slices,
                            WithEmptyPlaces(places.slices, distance));
  ISOSCOPE_ASSIGN_OR_RETURN(const SliceStack stack,
                            StackSlices(&slices, path, {.has_spacing = rules.has_spacing}));
  const absl::Status valid = volume::Validate(stack.geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(path, ": ", valid.message()));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const auto index_of, IndexSegments(*segmentation, places));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::size_t> layer_of,
                            ChooseLayers(*segmentation, places, index_of));
  const std::size_t layer_count = *std::max_element(layer_of.begin(), layer_of.end()) + 1;
  std::vector<LayerFrames> layers(layer_count);
  for (std::size_t z = 0; z < slices.size(); ++z) {
    if (slices[z].frame < 0) {
      continue;
    }
    for (const std::size_t frame : places.frames[static_cast<std::size_t>(slices[z].frame)]) {
      const std::int64_t segment = segmentation->frames.segment_kind == DicomSegmentKind::kLabelMap
                                       ? 0
                                       : segmentation->frame(frame).segment;
      layers[layer_of[index_of.at(segment)]][static_cast<std::int64_t>(z)].push_back(
          {.frame = frame, .segment = segment});
    }
  }
  const bool is_wide = segmentation->is_binary() ? index_of.rbegin()->first > 255
                                                 : segmentation->frames.pixels.bits_allocated == 16;
  std::vector<SourceField> fields = FieldsOfLayers(layer_count, field);
  if (segmentation->frames.segment_kind == DicomSegmentKind::kFractional && layer_count > 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(fields, FieldsOfShares(path, index_of));
  }
  return std::make_unique<SegmentationSeries>(segmentation,
                                              is_wide ? ScalarType::kUint16 : ScalarType::kUint8,
                                              stack.geometry, std::move(fields), std::move(layers));
}

}  // namespace isoscope::source
