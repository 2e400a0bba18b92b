// The members of a ZIP archive, and the bytes of one as a stream.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_ZIP_FILE_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_ZIP_FILE_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/io/file.h"
#include "core/source/bytes/decoded_stream.h"

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

// Returns true if a file begins as a ZIP archive that has a member.
bool IsZip(absl::string_view head);
// The name of the first member; "" if the bytes do not hold it.
std::string FirstZipName(absl::string_view head);

// Reads the directory at the end of an archive, in its order, also of Zip64.
// INVALID_ARGUMENT: no archive, or cut; several disks; bytes in front of it; a directory of more
// than 64 MiB or 200 000 members; two members of one name; sizes that the file can't hold, or that
// no deflated stream makes.
absl::StatusOr<std::vector<ZipMember>> ReadZipMembers(const io::RandomAccessFile& file);

// Returns the decoded bytes of a member, which end with its size. Reads check the local header
// first, and the size and the checksum where the last byte is read: all bytes, whatever is skipped.
// INVALID_ARGUMENT of Read: encrypted, another method, or not the member of the directory.
// DATA_LOSS: damaged. `file` must outlive the stream.
std::unique_ptr<DecodedStream> MakeZipStream(const ZipMember& member,
                                             const io::RandomAccessFile* file);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_ZIP_FILE_H_
