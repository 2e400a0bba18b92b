// The members of a ZIP archive, and the bytes of one as a stream.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_ZIP_FILE_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_ZIP_FILE_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/io/file.h"
#include "core/source/bytes/decoded_stream.h"
#include "core/source/bytes/zip_directory.h"

namespace isoscope::source {

// Returns true if a file begins as a ZIP archive that has a member.
bool IsZip(absl::string_view head);
// The name of the first member; "" if the bytes do not hold it.
std::string FirstZipName(absl::string_view head);

// ReadZipDirectory of a file.
absl::StatusOr<std::vector<ZipMember>> ReadZipMembers(const io::RandomAccessFile& file);

// Returns the decoded bytes of a member, which end with its size. Reads check the local header
// first, and the size and the checksum where the last byte is read: all bytes, whatever is skipped.
// INVALID_ARGUMENT of Read: encrypted, another method, or not the member of the directory.
// DATA_LOSS: damaged. `file` must outlive the stream.
std::unique_ptr<DecodedStream> MakeZipStream(const ZipMember& member,
                                             const io::RandomAccessFile* file);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_ZIP_FILE_H_
