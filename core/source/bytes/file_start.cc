#include "core/source/bytes/file_start.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>

#include "absl/strings/match.h"
#include "absl/strings/string_view.h"

#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/bytes/inflate_reader.h"

namespace isoscope::source {
namespace {

constexpr absl::string_view kGzip = "\x1f\x8b\x08";

}  // namespace

absl::StatusOr<FileStart> ReadFileStart(const std::string& path, std::size_t size) {
  ISOSCOPE_RETURN_IF_ERROR(base::CheckProcessInterrupt());  // of a folder with many files
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  FileStart head;
  head.bytes.resize(std::min<std::size_t>(size, static_cast<std::size_t>(file->size_bytes())));
  ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(0, head.bytes.size(), head.bytes.data()));
  head.is_gzip = absl::StartsWith(head.bytes, kGzip);
  if (head.is_gzip) {
    InflateReader inflater(file.get(), 0);
    head.bytes.resize(size);
    ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t got, inflater.Read(size, head.bytes.data()));
    head.bytes.resize(got);
  }
  return head;
}

bool IsGzipFile(const std::string& path) {
  const auto file = io::OpenRandomAccessFile(path);
  std::array<char, kGzip.size()> bytes{};
  return file.ok() && (*file)->ReadAt(0, bytes.size(), bytes.data()).ok() &&
         absl::string_view(bytes.data(), bytes.size()) == kGzip;
}

}  // namespace isoscope::source
