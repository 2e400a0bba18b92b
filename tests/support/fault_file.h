// Files that fail on purpose: decorators that pass everything on until a chosen byte.

#ifndef ISOSCOPE_TESTS_SUPPORT_FAULT_FILE_H_
#define ISOSCOPE_TESTS_SUPPORT_FAULT_FILE_H_

#include <cstdint>
#include <memory>
#include <string>

#include "core/io/file.h"

namespace isoscope::testing {

enum class ReadFault {
  kIoError,    // as EIO: DATA_LOSS
  kShortRead,  // as a file cut at the byte, whose size_bytes() is still the old one: DATA_LOSS
  kFlippedBit  // the byte's lowest bit is wrong, without an error
};

// Reads that touch byte `fault_offset` of `file` suffer `fault`.
std::unique_ptr<io::RandomAccessFile> MakeFaultyFile(std::unique_ptr<io::RandomAccessFile> file,
                                                     ReadFault fault, std::int64_t fault_offset);

// Returns a descriptor as a file that claims to have `size_bytes`; it closes the descriptor. So the
// system itself fails: /proc/self/mem has holes that read as EIO, a pipe blocks its readers.
std::unique_ptr<io::RandomAccessFile> MakeDescriptorFile(int descriptor, std::int64_t size_bytes,
                                                         const std::string& path);

// A disk that is full: writes that would bring the bytes written to more than `capacity_bytes`
// write what fits and return RESOURCE_EXHAUSTED, as ENOSPC; so do all later calls, Close() too.
std::unique_ptr<io::WritableFile> MakeFullDiskFile(std::unique_ptr<io::WritableFile> file,
                                                   std::int64_t capacity_bytes);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_FAULT_FILE_H_
