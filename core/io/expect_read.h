// Advises the system to read bytes of a file into its memory, ahead of their use.

#ifndef ISOSCOPE_CORE_IO_EXPECT_READ_H_
#define ISOSCOPE_CORE_IO_EXPECT_READ_H_

#include "absl/status/status.h"

#include "core/io/read_engine.h"

namespace isoscope::io {

// Tells the system that these bytes are read soon. It reads those that it lacks meanwhile; this
// does not wait for them. Does nothing for a file without a descriptor.
void ExpectRead(const FileRead& read);

// Waits until the last of these bytes is in memory. After ExpectRead mostly all are. Errors as
// RandomAccessFile::ReadAt. REQUIRES: read.size > 0.
absl::Status AwaitExpectedRead(const FileRead& read);

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_EXPECT_READ_H_
