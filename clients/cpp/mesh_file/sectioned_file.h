// A file whose header has counts that are known last, and whose sections all grow at the same time.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_SECTIONED_FILE_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_SECTIONED_FILE_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/io/atomic_file.h"
#include "core/io/file.h"

namespace isoscope::client {

// The disk that a file takes, without its header.
struct DiskUse {
  std::int64_t file_bytes = 0;  // of the finished file
  std::int64_t peak_bytes = 0;  // while it is put together; at least file_bytes
};

// The first section is written directly after the header, whose length is fixed. Each other section
// has its own file, which is appended at the end. So memory stays small whatever the file's size.
// Without Finish the destructor removes the written data. Thread-compatible.
class SectionedFile {
 public:
  // `path` appears at Finish, in one step. section_count >= 1. Errors as io::AtomicFile.
  static absl::StatusOr<std::unique_ptr<SectionedFile>> Create(const std::string& path,
                                                               std::size_t header_bytes,
                                                               std::size_t section_count);
  ~SectionedFile();
  SectionedFile(const SectionedFile&) = delete;
  SectionedFile& operator=(const SectionedFile&) = delete;

  absl::Status Append(std::size_t section, absl::string_view bytes);
  // Bytes of a section so far; of the first one without the header.
  [[nodiscard]] std::int64_t section_bytes(std::size_t section) const;

  // The disk that the sections so far take.
  [[nodiscard]] DiskUse disk_use() const;

  // Joins the sections. `between[i]` is written between section i and section i + 1 (none if it is
  // shorter), `tail` after the last. REQUIRES: header.size() is that of Create.
  absl::Status Finish(absl::string_view header, const std::vector<std::string>& between = {},
                      absl::string_view tail = "");
  // Size of the finished file.
  [[nodiscard]] std::int64_t size_bytes() const { return file_->size_bytes(); }

 private:
  // A section in its own temporary file.
  struct Section {
    std::string path;
    std::unique_ptr<io::WritableFile> file;
  };

  SectionedFile(std::size_t header_bytes, std::unique_ptr<io::AtomicFile> file)
      : header_bytes_(header_bytes), file_(std::move(file)) {}

  absl::Status AppendSection(const Section& section);

  const std::size_t header_bytes_;
  const std::unique_ptr<io::AtomicFile> file_;  // the header and the first section
  std::vector<Section> later_sections_;
};

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_SECTIONED_FILE_H_
