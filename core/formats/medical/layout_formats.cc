#include "core/formats/medical/layout_formats.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"

#include "core/base/coding.h"
#include "core/io/file.h"
#include "core/source/bytes/part_path.h"

namespace isoscope::source {
namespace {

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

// The three bytes at that place, or what there is of them.
absl::string_view MagicAt(absl::string_view head, std::size_t offset) {
  return head.substr(std::min(head.size(), offset), 3);
}

}  // namespace

bool IsNifti1Header(absl::string_view head) {
  const absl::string_view magic = MagicAt(head, 344);
  return HasNumber<std::int32_t>(head, 0, 348) && (magic == "n+1" || magic == "ni1");
}

bool IsNifti2Header(absl::string_view head) {
  const absl::string_view magic = MagicAt(head, 4);
  return HasNumber<std::int32_t>(head, 0, 540) && (magic == "n+2" || magic == "ni2");
}

bool IsAnalyzeHeader(absl::string_view head) {
  constexpr std::size_t kBytes = 348;
  const absl::string_view magic = MagicAt(head, 344);
  return head.size() >= kBytes && HasNumber<std::int32_t>(head, 0, kBytes) && magic != "n+1" &&
         magic != "ni1";
}

bool IsMghHeader(absl::string_view head) {
  constexpr std::size_t kNumberBytes = 28;
  if (head.size() < kNumberBytes) {
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

bool IsAfniHeader(absl::string_view head) {
  return absl::StartsWith(absl::StripLeadingAsciiWhitespace(head), "type") &&
         absl::StrContains(head, "-attribute") && absl::StrContains(head, "name");
}

bool IsParHeader(absl::string_view head) {
  return absl::StartsWith(head, "# === DATA DESCRIPTION FILE ===");
}

bool HasNiftiName(const std::string& path) {
  for (const char* ending : {".nii", ".nii.gz", ".hdr", ".hdr.gz", ".img", ".img.gz"}) {
    if (HasEnding(path, ending)) {
      return true;
    }
  }
  return false;
}

std::string LayoutHeaderPath(const std::string& path) {
  struct Pair {
    const char* samples;
    std::array<const char*, 3> headers;  // null behind the last one
  };
  constexpr std::array<Pair, 7> kPairs{{{".img", {".hdr", ".HDR", ".hdr.gz"}},
                                        {"2dseq", {"visu_pars"}},
                                        {".rec", {".PAR", ".par"}},
                                        {".img.gz", {".hdr", ".HDR", ".hdr.gz"}},
                                        {".brik", {".HEAD", ".head"}},
                                        {".brik.gz", {".HEAD", ".head"}},
                                        {".brik.bz2", {".HEAD", ".head"}}}};
  for (const Pair& pair : kPairs) {
    if (HasEnding(path, pair.samples)) {
      const std::string stem = path.substr(0, path.size() - std::string(pair.samples).size());
      for (const char* header : pair.headers) {
        if (header != nullptr && io::PathExists(stem + header)) {
          return stem + header;
        }
      }
      return stem + pair.headers[0];
    }
  }
  return path;
}

}  // namespace isoscope::source
