#include "core/source/dicom_source.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <filesystem>
#include <map>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "itkGDCMImageIO.h"
#include "itkMetaDataObject.h"
#include "itkObject.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/itk_types.h"
#include "core/source/slice_source.h"

namespace isoscope::source {
namespace {

struct Slice {
  std::string path;
  std::string series;  // its UID
  std::int64_t width = 0;
  std::int64_t height = 0;
  volume::ScalarType type = volume::ScalarType::kUint8;
  math::Vec3d origin;
  math::Vec3d spacing;
  math::Mat3d direction;
  double position = 0;  // along the normal
};

math::Vec3d VectorOf(const std::vector<double>& v) { return {v[0], v[1], v[2]}; }

bool IsNear(const math::Vec3d& a, const math::Vec3d& b, double tolerance) {
  return math::Length(a - b) <= tolerance;
}

itk::GDCMImageIO::Pointer ReadHeader(const std::string& path) {
  const auto io = itk::GDCMImageIO::New();
  io->SetFileName(path);
  io->ReadImageInformation();
  return io;
}

// Whether every element up to the end of the pixels lies within the file. GDCM ends the process by
// an assertion where some of them are cut, so that files are looked through before. Big-endian and
// deflated files pass unseen.
// Source: DICOM PS3.5, section 7 (data elements), annex A.4 (encapsulated pixels); PS3.10,
// section 7.
class ElementWalker {
 public:
  explicit ElementWalker(const io::RandomAccessFile* file) : file_(*file) {}

  absl::StatusOr<bool> IsWhole() {
    constexpr std::int64_t kMeta = 132;
    char head[12];
    if (!Has(kMeta, sizeof(head))) {
      return false;
    }
    ISOSCOPE_RETURN_IF_ERROR(file_.ReadAt(128, 4, head));
    if (std::memcmp(head, "DICM", 4) != 0) {
      return false;
    }
    ISOSCOPE_RETURN_IF_ERROR(file_.ReadAt(kMeta, sizeof(head), head));
    if (std::memcmp(head, "\2\0\0\0UL\4\0", 8) != 0) {
      return false;
    }
    const std::int64_t meta_bytes = base::LoadLittleEndian<std::uint32_t>(head + 8);
    constexpr std::int64_t kMaxMetaBytes = 1 << 20;
    position_ = kMeta + 12;
    if (meta_bytes > kMaxMetaBytes || !Has(position_, meta_bytes)) {
      return false;
    }
    std::string meta(static_cast<std::size_t>(meta_bytes), '\0');
    ISOSCOPE_RETURN_IF_ERROR(file_.ReadAt(position_, meta.size(), meta.data()));
    position_ += meta_bytes;
    constexpr absl::string_view kBigEndian("1.2.840.10008.1.2.2\0", 20);
    constexpr absl::string_view kDeflated = "1.2.840.10008.1.2.1.99";
    if (absl::StrContains(meta, kBigEndian) || absl::StrContains(meta, kDeflated)) {
      return Has(position_, 8);
    }
    is_explicit_ = absl::StrContains(meta, "1.2.840.10008.1.2.");
    return WalkToEndOfPixels();
  }

 private:
  [[nodiscard]] bool Has(std::int64_t offset, std::int64_t size) const {
    return size <= file_.size_bytes() - offset;
  }

  absl::StatusOr<bool> WalkToEndOfPixels() {
    constexpr std::uint32_t kUndefined = 0xffffffff;
    constexpr std::uint32_t kPixels = 0x7fe00010;
    constexpr std::uint32_t kItemGroup = 0xfffe;
    constexpr std::uint32_t kItem = 0xfffee000;
    constexpr std::uint32_t kSequenceEnd = 0xfffee0dd;
    bool is_in_pixels = false;
    while (Has(position_, 8)) {
      char head[12] = {};
      const std::int64_t head_bytes = std::min<std::int64_t>(12, file_.size_bytes() - position_);
      ISOSCOPE_RETURN_IF_ERROR(file_.ReadAt(position_, static_cast<std::size_t>(head_bytes), head));
      const std::uint32_t group = base::LoadLittleEndian<std::uint16_t>(head);
      const std::uint32_t tag = group << 16 | base::LoadLittleEndian<std::uint16_t>(head + 2);
      std::uint32_t length = base::LoadLittleEndian<std::uint32_t>(head + 4);
      position_ += 8;
      if (group != kItemGroup && is_explicit_) {
        // Some kinds have a length of 32 bits behind two empty bytes, all others one of 16.
        static constexpr absl::string_view kLong = "OB OD OF OL OV OW SQ SV UC UN UR UT UV";
        if (kLong.find(absl::string_view(head + 4, 2)) != absl::string_view::npos) {
          length = base::LoadLittleEndian<std::uint32_t>(head + 8);
          position_ += 4;
        } else {
          length = base::LoadLittleEndian<std::uint16_t>(head + 6);
        }
      }
      if (tag == kPixels && length != kUndefined) {
        return Has(position_, length);
      }
      is_in_pixels = is_in_pixels || tag == kPixels;
      if (is_in_pixels && tag == kSequenceEnd) {
        return true;
      }
      // Sequences and items of undefined length are gone through, all else is stepped over; so are
      // items outside of pixels, element by element.
      if (length != kUndefined && (is_in_pixels || tag != kItem)) {
        if (!Has(position_, length)) {
          return false;
        }
        position_ += length;
      }
    }
    return false;
  }

  const io::RandomAccessFile& file_;
  std::int64_t position_ = 0;
  bool is_explicit_ = false;
};

absl::Status CheckIsWhole(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const bool is_whole, ElementWalker(file.get()).IsWhole());
  if (!is_whole) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: its %d bytes do not hold a DICOM image up to the end of its pixels: it is cut or "
        "damaged, or no image (then put it elsewhere)",
        path, file->size_bytes()));
  }
  return absl::OkStatus();
}

absl::StatusOr<Slice> ReadSliceHeader(const std::string& path) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsWhole(path));
  itk::GDCMImageIO::Pointer io;
  try {
    io = ReadHeader(path);
  } catch (const itk::ExceptionObject& error) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": can't be read as a DICOM image: ", error.GetDescription(),
                     ": if it is none, put it elsewhere"));
  }
  Slice slice;
  slice.path = path;
  itk::ExposeMetaData(io->GetMetaDataDictionary(), "0020|000e", slice.series);
  if (io->GetNumberOfDimensions() > 2 && io->GetDimensions(2) > 1) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d frames in one file; expected one slice a file: split it (gdcmimg --split), or "
        "convert it (dcm2niix)",
        path, io->GetDimensions(2)));
  }
  if (io->GetNumberOfComponents() != 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d components a sample (a colour image); expected greyscale", path,
                        io->GetNumberOfComponents()));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(slice.type, ScalarTypeOf(io->GetComponentType(), path));
  slice.width = static_cast<std::int64_t>(io->GetDimensions(0));
  slice.height = static_cast<std::int64_t>(io->GetDimensions(1));
  for (unsigned axis = 0; axis < 3; ++axis) {
    slice.direction.columns[axis] = VectorOf(io->GetDirection(axis));
    slice.origin[static_cast<int>(axis)] = io->GetOrigin(axis);
    slice.spacing[static_cast<int>(axis)] = io->GetSpacing(axis);
  }
  slice.position = math::Dot(slice.origin, slice.direction.columns[2]);
  return slice;
}

// Sorts by position, checks that the slices are one volume, and returns its geometry.
absl::StatusOr<volume::GridGeometry> StackSlices(std::vector<Slice>* slices,
                                                 const std::string& name) {
  std::stable_sort(slices->begin(), slices->end(),
                   [](const Slice& a, const Slice& b) { return a.position < b.position; });
  const Slice& first = slices->front();
  for (const Slice& slice : *slices) {
    if (slice.width != first.width || slice.height != first.height || slice.type != first.type) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %d x %d samples of %s, but %s has %d x %d of %s: expected slices of one size and "
          "type",
          slice.path, slice.width, slice.height, volume::NameOf(slice.type), first.path,
          first.width, first.height, volume::NameOf(first.type)));
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!IsNear(slice.direction.columns[axis], first.direction.columns[axis], 1e-3)) {
        return absl::InvalidArgumentError(
            absl::StrFormat("%s: its orientation differs from that of %s: expected parallel slices",
                            slice.path, first.path));
      }
    }
    if (std::abs(slice.spacing.x - first.spacing.x) > 1e-3 * first.spacing.x ||
        std::abs(slice.spacing.y - first.spacing.y) > 1e-3 * first.spacing.y) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: pixels of %g x %g, but %s has %g x %g: expected slices of one spacing", slice.path,
          slice.spacing.x, slice.spacing.y, first.path, first.spacing.x, first.spacing.y));
    }
  }
  if (slices->size() < 2) {
    return absl::InvalidArgumentError(
        absl::StrCat(name, ": a series of one slice (", first.path, "); expected two or more"));
  }
  const auto gaps = static_cast<double>(slices->size() - 1);
  const double distance = (slices->back().position - first.position) / gaps;
  for (std::size_t i = 1; i < slices->size(); ++i) {
    const Slice& slice = (*slices)[i];
    const double gap = slice.position - (*slices)[i - 1].position;
    if (!(std::abs(gap - distance) <= 0.01 * distance) || distance <= 0) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %g behind %s, where %g is the mean distance of %d slices: expected slices at one "
          "distance (one is missing, or there twice)",
          slice.path, gap, (*slices)[i - 1].path, distance, slices->size()));
    }
    const math::Vec3d expected =
        first.origin + first.direction.columns[2] * (slice.position - first.position);
    if (!IsNear(slice.origin, expected, 0.01 * distance + 0.01 * first.spacing.x)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: begins %g beside the normal of the slices (a tilted gantry?): expected a straight "
          "stack; resample it first",
          slice.path, math::Length(slice.origin - expected)));
    }
  }
  volume::GridGeometry geometry;
  geometry.sample_dims = {first.width, first.height, static_cast<std::int64_t>(slices->size())};
  geometry.spacing = {first.spacing.x, first.spacing.y, distance};
  geometry.origin = first.origin;
  geometry.direction = first.direction;
  return geometry;
}

class DicomReader final : public SliceReader {
 public:
  explicit DicomReader(std::vector<Slice> slices) : slices_(std::move(slices)) {}

  absl::Status ReadSlice(std::int64_t z, char* out) override {
    const Slice& slice = slices_[static_cast<std::size_t>(z)];
    ISOSCOPE_RETURN_IF_ERROR(CheckIsWhole(slice.path));
    try {
      const itk::GDCMImageIO::Pointer io = ReadHeader(slice.path);
      ISOSCOPE_ASSIGN_OR_RETURN(const volume::ScalarType type,
                                ScalarTypeOf(io->GetComponentType(), slice.path));
      if (static_cast<std::int64_t>(io->GetDimensions(0)) != slice.width ||
          static_cast<std::int64_t>(io->GetDimensions(1)) != slice.height || type != slice.type ||
          io->GetNumberOfComponents() != 1) {
        return absl::DataLossError(
            absl::StrCat(slice.path, ": changed while it was read; start again"));
      }
      io->Read(out);
      return absl::OkStatus();
    } catch (const itk::ExceptionObject& error) {
      return absl::DataLossError(
          absl::StrCat(slice.path, ": can't be decoded as DICOM: ", error.GetDescription()));
    } catch (const std::exception& error) {
      return absl::DataLossError(
          absl::StrCat(slice.path, ": can't be decoded as DICOM: ", error.what()));
    }
  }

 private:
  const std::vector<Slice> slices_;
};

// The slices of the series that `path` names.
absl::StatusOr<std::vector<Slice>> FindSeries(const std::string& path) {
  const bool is_folder = io::IsDirectory(path);
  const std::string folder = DicomFolder(path);
  std::map<std::string, std::vector<Slice>> series;  // by its UID
  for (const std::string& file : DicomFilesIn(folder)) {
    ISOSCOPE_ASSIGN_OR_RETURN(Slice slice, ReadSliceHeader(file));
    series[slice.series].push_back(std::move(slice));
  }
  if (series.empty()) {
    return absl::NotFoundError(absl::StrCat(folder, ": a folder without DICOM files"));
  }
  if (!is_folder) {
    ISOSCOPE_ASSIGN_OR_RETURN(const Slice slice, ReadSliceHeader(path));
    return series[slice.series];
  }
  if (series.size() > 1) {
    std::vector<std::string> lines;
    for (const auto& [uid, slices] : series) {
      lines.push_back(
          absl::StrFormat("%d slices, for example %s", slices.size(), slices.front().path));
    }
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d series; give a file of the one that is meant: %s", path,
                        series.size(), absl::StrJoin(lines, "; ")));
  }
  return series.begin()->second;
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenSeries(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<Slice> slices, FindSeries(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry, StackSlices(&slices, path));
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(path, ": ", valid.message()));
  }
  const volume::ScalarType type = slices.front().type;
  return MakeSliceSource(geometry, type, path, std::make_unique<DicomReader>(std::move(slices)));
}

}  // namespace

bool IsDicomFile(const std::string& path) {
  constexpr std::int64_t kMarkOffset = 128;
  const auto file = io::OpenRandomAccessFile(path);
  char mark[4];
  return file.ok() && (*file)->size_bytes() >= kMarkOffset + 4 &&
         (*file)->ReadAt(kMarkOffset, sizeof(mark), mark).ok() &&
         std::memcmp(mark, "DICM", sizeof(mark)) == 0;
}

std::vector<std::string> DicomFilesIn(const std::string& folder) {
  std::vector<std::string> files;
  std::error_code error;
  for (std::filesystem::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string path = entry->path().string();
    if (entry->path().filename() != "DICOMDIR" && IsDicomFile(path)) {
      files.push_back(path);
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::string DicomFolder(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return io::IsDirectory(path) ? path : slash == std::string::npos ? "." : path.substr(0, slash);
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenDicomSeries(const std::string& path) {
  try {
    itk::Object::GlobalWarningDisplayOff();
    return OpenSeries(path);
  } catch (const itk::ExceptionObject& error) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": can't be read as DICOM: ", error.GetDescription()));
  } catch (const std::exception& error) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": can't be read as DICOM: ", error.what()));
  }
}

}  // namespace isoscope::source
