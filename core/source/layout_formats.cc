#include "core/source/layout_formats.h"

#include <algorithm>
#include <array>
#include <memory>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kHeadBytes = 352;

// A number of either byte order.
template <typename T>
bool HasNumber(absl::string_view head, std::size_t offset, T number) {
  if (head.size() < offset + sizeof(T)) {
    return false;
  }
  std::array<char, sizeof(T)> bytes;
  std::copy_n(head.data() + offset, sizeof(T), bytes.begin());
  const bool is_little = base::LoadLittleEndian<T>(bytes.data()) == number;
  std::reverse(bytes.begin(), bytes.end());
  return is_little || base::LoadLittleEndian<T>(bytes.data()) == number;
}

bool IsNifti2(absl::string_view /*path*/, absl::string_view head) {
  const absl::string_view magic = head.substr(std::min<std::size_t>(head.size(), 4), 3);
  return HasNumber<std::int32_t>(head, 0, 540) && (magic == "n+2" || magic == "ni2");
}

bool IsAnalyze(absl::string_view path, absl::string_view head) {
  const absl::string_view magic = head.substr(std::min<std::size_t>(head.size(), 344), 3);
  return absl::EndsWithIgnoreCase(path, ".hdr") && HasNumber<std::int32_t>(head, 0, 348) &&
         magic != "n+1" && magic != "ni1";
}

// Its magic is but a version, 1; the name or the sizes must tell, too.
bool IsMgh(absl::string_view path, absl::string_view head) {
  if (absl::EndsWithIgnoreCase(path, ".mgz") || absl::EndsWithIgnoreCase(path, ".mgh") ||
      absl::EndsWithIgnoreCase(path, ".mgh.gz")) {
    return true;
  }
  constexpr std::size_t kNumbers = 28;
  if (head.size() < kNumbers || absl::StrContains(path.substr(path.rfind('/') + 1), '.')) {
    return false;
  }
  const auto number = [head](std::size_t index) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      value = value << 8 | static_cast<unsigned char>(head[4 * index + i]);
    }
    return value;
  };
  const auto is_size = [&](std::size_t index) {
    return number(index) >= 1 && number(index) <= 65536;
  };
  return number(0) == 1 && is_size(1) && is_size(2) && is_size(3) && is_size(4) && number(5) <= 10;
}

bool IsAfni(absl::string_view path, absl::string_view head) {
  return absl::EndsWithIgnoreCase(path, ".head") ||
         (absl::StartsWith(absl::StripLeadingAsciiWhitespace(head), "type") &&
          absl::StrContains(head, "-attribute") && absl::StrContains(head, "name"));
}

bool IsParRec(absl::string_view path, absl::string_view head) {
  return absl::EndsWithIgnoreCase(path, ".par") ||
         absl::StartsWith(head, "# === DATA DESCRIPTION FILE ===");
}

}  // namespace

absl::StatusOr<FileHead> ReadFileHead(const std::string& path, std::size_t size) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  FileHead head;
  head.bytes.resize(
      static_cast<std::size_t>(std::min(file->size_bytes(), static_cast<std::int64_t>(size))));
  ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(0, head.bytes.size(), head.bytes.data()));
  if (absl::StartsWith(head.bytes, "\x1f\x8b")) {
    head.encoding = SampleEncoding::kDeflate;
  } else if (absl::StartsWith(head.bytes, "BZh")) {
    head.encoding = SampleEncoding::kBzip2;
  } else {
    return head;
  }
  const std::unique_ptr<DecodedStream> stream =
      MakeDecodedStream(head.encoding, volume::ScalarType::kUint8, file.get(), 0);
  head.bytes.resize(size);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t got, stream->Read(size, head.bytes.data()));
  head.bytes.resize(got);
  return head;
}

const std::vector<LayoutFormat>& LayoutFormats() {
  static const auto& formats = *new std::vector<LayoutFormat>{
      {"NIfTI-2", ".nii .nii.gz .hdr .img .img.gz", IsNifti2, ReadNifti2Layout},
      {"Analyze 7.5", ".hdr .img .img.gz", IsAnalyze, ReadAnalyzeLayout},
      {"MGH", ".mgh .mgz", IsMgh, ReadMghLayout},
      {"AFNI", ".HEAD .BRIK .BRIK.gz .BRIK.bz2", IsAfni, ReadAfniLayout},
      {"PAR/REC", ".PAR .REC", IsParRec, ReadParRecLayout}};
  return formats;
}

const LayoutFormat* FindLayoutFormat(const std::string& path) {
  const std::string header_path = LayoutHeaderPath(path);
  if (!io::PathExists(header_path) || io::IsDirectory(header_path)) {
    return nullptr;
  }
  const absl::StatusOr<FileHead> head = ReadFileHead(header_path, kHeadBytes);
  if (!head.ok()) {
    return nullptr;  // the reader of another format says why
  }
  for (const LayoutFormat& format : LayoutFormats()) {
    if (format.matches(header_path, head->bytes)) {
      return &format;
    }
  }
  return nullptr;
}

std::string LayoutHeaderPath(const std::string& path) {
  struct Pair {
    const char* samples;
    std::array<const char*, 2> headers;
  };
  constexpr std::array<Pair, 6> kPairs{{{".img", {".hdr", ".HDR"}},
                                        {".img.gz", {".hdr", ".HDR"}},
                                        {".brik", {".HEAD", ".head"}},
                                        {".brik.gz", {".HEAD", ".head"}},
                                        {".brik.bz2", {".HEAD", ".head"}},
                                        {".rec", {".PAR", ".par"}}}};
  for (const Pair& pair : kPairs) {
    if (absl::EndsWithIgnoreCase(path, pair.samples)) {
      const std::string stem = path.substr(0, path.size() - std::string(pair.samples).size());
      for (const char* header : pair.headers) {
        if (io::PathExists(stem + header)) {
          return stem + header;
        }
      }
      return stem + pair.headers[0];
    }
  }
  return path;
}

}  // namespace isoscope::source
