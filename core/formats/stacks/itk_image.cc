// The parent checks names; the child finds the files anew, opens them and reads. ITK reads these
// formats whole, and some of its readers take a cut file for a complete one, with what the memory
// held. So the child compares the size of files that are not compressed first.
//
// Source: the readers of ITK 5.2, https://itk.org/Doxygen52/html.

#include "core/formats/stacks/itk_image.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <optional>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "itkBMPImageIO.h"
#include "itkBioRadImageIO.h"
#include "itkPNGImageIO.h"
#include "itkStimulateImageIO.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/bytes/binary_header.h"
#include "core/source/bytes/file_start.h"
#include "core/source/child/itk_types.h"
#include "core/source/child/silent_libraries.h"
#include "core/source/child/walled_source.h"
#include "core/source/single_series.h"

namespace isoscope::source {
namespace {

template <typename Io>
itk::ImageIOBase::Pointer MakeIo() {
  return itk::ImageIOBase::Pointer(Io::New().GetPointer());
}

constexpr std::int64_t kBioRadHeaderBytes = 76;

// Behind a header that is cut, ITK looks for notes without an end.
absl::Status CheckBioRad(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, io::OpenRandomAccessFile(path));
  if (file->size_bytes() < kBioRadHeaderBytes) {
    return absl::DataLossError(absl::StrFormat("%s: the BioRad header has %d bytes, expected %d",
                                               path, file->size_bytes(), kBioRadHeaderBytes));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::int64_t> LeastBioRadBytes(const std::string& /*path*/,
                                              std::int64_t sample_bytes) {
  return kBioRadHeaderBytes + sample_bytes;
}

absl::StatusOr<std::int64_t> LeastBmpBytes(const std::string& path, std::int64_t /*sample_bytes*/) {
  constexpr std::size_t kHeaderBytes = 54;
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart head, ReadFileStart(path, kHeaderBytes));
  if (head.bytes.size() < kHeaderBytes) {
    return absl::DataLossError(absl::StrFormat("%s: the BMP header has %d bytes, expected %d", path,
                                               head.bytes.size(), kHeaderBytes));
  }
  const BinaryHeader header(head.bytes, false);
  const auto compression = header.Load<std::uint32_t>(30);
  if (compression != 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: BMP of compression %d; expected none: convert it (ImageMagick: convert IN -compress "
        "none OUT)",
        path, compression));
  }
  const std::int64_t width = std::abs(std::int64_t{header.Load<std::int32_t>(18)});
  const std::int64_t height = std::abs(std::int64_t{header.Load<std::int32_t>(22)});
  if (width > kMaxSliceSamples || height > kMaxSliceSamples) {  // ITK read another kind of header
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: a BMP header of %d x %d samples; expected at most %d along each axis",
                        path, width, height, kMaxSliceSamples));
  }
  const std::int64_t row = (width * header.Load<std::uint16_t>(28) + 31) / 32 * 4;
  return std::int64_t{header.Load<std::uint32_t>(10)} + row * height;
}

struct ItkFormat {
  const char* ending;
  const char* name;
  itk::ImageIOBase::Pointer (*make)();
  bool is_slice;
  absl::Status (*check)(const std::string& path);  // before ITK reads; may be null
  // The least size of a whole file; null: ITK's reader finds out that a file is cut.
  absl::StatusOr<std::int64_t> (*least_bytes)(const std::string& path, std::int64_t sample_bytes);
};

constexpr std::array<ItkFormat, 4> kFormats{{
    {".pic", "BioRad", MakeIo<itk::BioRadImageIO>, false, CheckBioRad, LeastBioRadBytes},
    {".spr", "Stimulate", MakeIo<itk::StimulateImageIO>, false, nullptr, nullptr},
    {".png", "PNG", MakeIo<itk::PNGImageIO>, true, nullptr, nullptr},
    {".bmp", "BMP", MakeIo<itk::BMPImageIO>, true, nullptr, LeastBmpBytes},
}};

const ItkFormat* FormatOf(const std::string& path) {
  const auto found = std::find_if(kFormats.begin(), kFormats.end(), [&](const ItkFormat& format) {
    return absl::EndsWithIgnoreCase(path, format.ending);
  });
  return found == kFormats.end() ? nullptr : found;
}

// An image whose header was read.
struct ItkHeader {
  itk::ImageIOBase::Pointer io;
  volume::ScalarType type = volume::ScalarType::kUint8;
  math::Index3 dims{1, 1, 1};

  [[nodiscard]] std::int64_t bytes() const {
    return dims.x * dims.y * dims.z * static_cast<std::int64_t>(volume::SizeOf(type));
  }
};

// True if the image has no palette, or colour i of it is grey i.
bool HasGreyPalette(const itk::ImageIOBase& io) {
  if (!io.GetIsReadAsScalarPlusPalette()) {
    return true;
  }
  const auto* const bmp = dynamic_cast<const itk::BMPImageIO*>(&io);
  if (bmp == nullptr) {
    return false;
  }
  const auto& colours = bmp->GetColorPalette();
  for (std::size_t i = 0; i < colours.size(); ++i) {
    if (colours[i].GetRed() != i || colours[i].GetGreen() != i || colours[i].GetBlue() != i) {
      return false;
    }
  }
  return true;
}

absl::StatusOr<ItkHeader> ReadHeader(const std::string& path) {
  const ItkFormat* const format = FormatOf(path);
  ISOSCOPE_CHECK(format != nullptr);
  if (format->check != nullptr) {
    ISOSCOPE_RETURN_IF_ERROR(format->check(path));
  }
  ItkHeader header;
  try {
    header.io = format->make();
    header.io->SetFileName(path);
    header.io->ExpandRGBPaletteOff();
    header.io->ReadImageInformation();
  } catch (const std::exception& error) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: can't be read as %s: %s", path, format->name, TextOfItk(error)));
  }
  const itk::ImageIOBase& io = *header.io;
  if (io.GetNumberOfComponents() != 1 || !HasGreyPalette(io)) {
    return ColourSliceError(path);
  }
  const unsigned axes = io.GetNumberOfDimensions();
  for (unsigned axis = 0; axis < axes; ++axis) {
    const auto count = static_cast<std::int64_t>(io.GetDimensions(axis));
    if (count < 1 || count > kMaxSliceSamples ||
        (axis >= (format->is_slice ? 2U : 3U) && count != 1)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: axis %d has %d samples; expected one %s of 1 to %d along each axis", path, axis,
          count, format->is_slice ? "slice" : "three-dimensional volume", kMaxSliceSamples));
    }
    (axis == 0 ? header.dims.x : axis == 1 ? header.dims.y : header.dims.z) *= count;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(header.type, ScalarTypeOf(io.GetComponentType(), path));
  if (format->least_bytes != nullptr) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t least, format->least_bytes(path, header.bytes()));
    ISOSCOPE_ASSIGN_OR_RETURN(const auto file, io::OpenRandomAccessFile(path));
    if (file->size_bytes() < least) {
      return absl::DataLossError(absl::StrFormat("%s: %d bytes, expected %d: the file is cut", path,
                                                 file->size_bytes(), least));
    }
  }
  return header;
}

// Reads the whole image.
absl::Status ReadImage(const ItkHeader& header, const std::string& path, char* out) {
  try {
    const unsigned axes = header.io->GetNumberOfDimensions();
    itk::ImageIORegion region(axes);
    for (unsigned axis = 0; axis < axes; ++axis) {
      region.SetIndex(axis, 0);
      region.SetSize(axis, header.io->GetDimensions(axis));
    }
    header.io->SetIORegion(region);
    header.io->Read(out);
  } catch (const std::exception& error) {
    return absl::DataLossError(
        absl::StrFormat("%s: can't be read, the file may be cut: %s", path, TextOfItk(error)));
  }
  return absl::OkStatus();
}

class WholeImage final : public VolumeSource {
 public:
  WholeImage(ItkHeader header, const volume::GridGeometry& geometry, std::string path)
      : header_(std::move(header)), geometry_(geometry), path_(std::move(path)) {}

  [[nodiscard]] const volume::GridGeometry& geometry() const override { return geometry_; }
  [[nodiscard]] volume::ScalarType scalar_type() const override { return header_.type; }
  [[nodiscard]] std::optional<volume::PatientFrame> patient_frame() const override {
    return std::nullopt;
  }
  [[nodiscard]] const std::string& name() const override { return path_; }
  [[nodiscard]] bool is_seekable() const override { return true; }
  [[nodiscard]] std::int64_t memory_bytes() const override { return header_.bytes(); }

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    if (samples_.empty()) {
      samples_.resize(static_cast<std::size_t>(header_.bytes()));
      ISOSCOPE_RETURN_IF_ERROR(ReadImage(header_, path_, samples_.data()));
    }
    const std::int64_t row =
        header_.dims.x * static_cast<std::int64_t>(volume::SizeOf(header_.type));
    std::memcpy(out, samples_.data() + begin_row * row,
                static_cast<std::size_t>((end_row - begin_row) * row));
    return absl::OkStatus();
  }

 private:
  const ItkHeader header_;
  const volume::GridGeometry geometry_;
  const std::string path_;
  std::vector<char> samples_;  // none until the first read
};

// In the child.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenWhole(const std::string& path,
                                                        const std::string& /*part*/) {
  ISOSCOPE_ASSIGN_OR_RETURN(ItkHeader header, ReadHeader(path));
  volume::GridGeometry geometry;
  geometry.sample_dims = header.dims;
  if (header.io->GetNumberOfDimensions() >= 3) {
    geometry.spacing = {header.io->GetSpacing(0), header.io->GetSpacing(1),
                        header.io->GetSpacing(2)};
    geometry.origin = {header.io->GetOrigin(0), header.io->GetOrigin(1), header.io->GetOrigin(2)};
  }
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(path, ": ", valid.message()));
  }
  return std::make_unique<WholeImage>(std::move(header), geometry, path);
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenItkChild(const std::string& path) {
  SilenceImageLibraries();  // first, so that its lock is free when the process forks
  return OpenWalled({.name = "ITK", .open = OpenWhole}, path);
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenItkImage(const std::string& path,
                                                           const std::string& field) {
  const ItkFormat* const format = FormatOf(path);
  if (format == nullptr || format->is_slice) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": expected a name that ends in .pic or .spr"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> volume, OpenItkChild(path));
  return MakeSingleSeries(
      {.path = path, .field = field, .volume = std::move(volume), .open = [path] {
         return OpenItkChild(path);
       }});
}

absl::StatusOr<SliceImage> ReadItkSlice(const std::string& path, SlicePart part) {
  ISOSCOPE_ASSIGN_OR_RETURN(const ItkHeader header, ReadHeader(path));
  SliceImage slice{.width = header.dims.x, .height = header.dims.y, .type = header.type};
  if (part == SlicePart::kAll) {
    slice.samples.resize(static_cast<std::size_t>(header.bytes()));
    ISOSCOPE_RETURN_IF_ERROR(ReadImage(header, path, slice.samples.data()));
  }
  return slice;
}

}  // namespace isoscope::source
