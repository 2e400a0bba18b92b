// The directory of a ZIP archive: its members, and where they lie.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_ZIP_DIRECTORY_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_ZIP_DIRECTORY_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/units.h"

namespace isoscope::source {

// What the directory of the archive says of a member.
struct ZipMember {
  std::string name{};              // as it stands there: may have folders, and any bytes
  std::int64_t header_offset = 0;  // of its local header, in the file
  std::int64_t stored_bytes = 0;
  std::int64_t size_bytes = 0;  // decoded
  std::uint32_t crc32 = 0;      // of the decoded bytes
  int method = 0;               // 0: stored; 8: deflated
  bool is_encrypted = false;

  // A folder is a member of its own, without bytes.
  [[nodiscard]] bool is_folder() const { return !name.empty() && name.back() == '/'; }
};

// The bytes of an archive.
struct ZipBytes {
  std::string name;  // for messages
  std::int64_t size_bytes = 0;
  // Reads `size` bytes from `offset` on into `out`; these lie in the archive.
  absl::FunctionRef<absl::Status(std::int64_t offset, std::size_t size, char* out)> read_at;
};

struct ZipLimits {
  std::int64_t directory_bytes = 64 * base::kMiB;
  std::int64_t members = 200'000;
  // Of two members of one name the last one counts, as for unzip; else they are an error.
  bool takes_last_of_a_name = false;
};

// Reads the directory at the end of an archive, in its order, also of Zip64. Of members of one name
// that are taken, all are returned.
// INVALID_ARGUMENT: no archive, or cut; several disks; bytes in front of it; a directory beyond the
// limits; two members of one name, unless the limits take them; sizes that the file can't hold, or
// that no deflated stream makes. Otherwise errors of reading.
absl::StatusOr<std::vector<ZipMember>> ReadZipDirectory(const ZipBytes& archive,
                                                        const ZipLimits& limits);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_ZIP_DIRECTORY_H_
