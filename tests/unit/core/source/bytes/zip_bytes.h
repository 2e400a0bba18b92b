// ZIP archives of known members.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_SOURCE_BYTES_ZIP_BYTES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_SOURCE_BYTES_ZIP_BYTES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "core/base/coding.h"
#include "tests/support/volume_files.h"
#include "zlib.h"

namespace isoscope::testing {

struct ZipEntry {
  std::string name;
  std::string bytes;
  bool is_deflated = false;
  // Faults: what headers say in place of what is true.
  std::uint16_t flags = 0;
  int method = -1;
  std::int64_t crc = -1;
  std::int64_t size = -1;
  std::string local_name{};
};

struct ZipOptions {
  bool is_long = false;  // Zip64: all sizes, offsets and counts in records of 64 bits
  std::string comment{};
};

inline std::string ZipBytes(const std::vector<ZipEntry>& entries, const ZipOptions& options = {}) {
  using base::AppendLittleEndian;
  std::string file;
  std::string directory;
  for (const ZipEntry& entry : entries) {
    const std::string stored = entry.is_deflated ? Deflate(entry.bytes, -15) : entry.bytes;
    const auto method =
        static_cast<std::uint16_t>(entry.method >= 0 ? entry.method : (entry.is_deflated ? 8 : 0));
    const auto crc = static_cast<std::uint32_t>(
        entry.crc >= 0
            ? static_cast<std::uint64_t>(entry.crc)
            : crc32_z(0, reinterpret_cast<const Bytef*>(entry.bytes.data()), entry.bytes.size()));
    const auto size = static_cast<std::uint64_t>(
        entry.size >= 0 ? entry.size : static_cast<std::int64_t>(entry.bytes.size()));
    const std::uint64_t offset = file.size();
    const std::string& local = entry.local_name.empty() ? entry.name : entry.local_name;
    const auto in_32 = [&](std::uint64_t number) {
      return options.is_long ? std::uint32_t{0xffffffff} : static_cast<std::uint32_t>(number);
    };
    file += std::string("PK\x03\x04", 4);
    for (const std::uint16_t word :
         {std::uint16_t{45}, entry.flags, method, std::uint16_t{0}, std::uint16_t{0}}) {
      AppendLittleEndian(word, &file);
    }
    AppendLittleEndian(crc, &file);
    AppendLittleEndian(in_32(stored.size()), &file);
    AppendLittleEndian(in_32(size), &file);
    AppendLittleEndian(static_cast<std::uint16_t>(local.size()), &file);
    AppendLittleEndian(std::uint16_t{5}, &file);
    file += local + std::string("\x09\x09\x01\0x", 5) + stored;  // an extra field of no meaning

    directory += std::string("PK\x01\x02", 4);
    for (const std::uint16_t word : {std::uint16_t{45}, std::uint16_t{45}, entry.flags, method,
                                     std::uint16_t{0}, std::uint16_t{0}}) {
      AppendLittleEndian(word, &directory);
    }
    AppendLittleEndian(crc, &directory);
    AppendLittleEndian(in_32(stored.size()), &directory);
    AppendLittleEndian(in_32(size), &directory);
    AppendLittleEndian(static_cast<std::uint16_t>(entry.name.size()), &directory);
    AppendLittleEndian(static_cast<std::uint16_t>(options.is_long ? 33 : 5), &directory);
    AppendLittleEndian(std::uint16_t{2}, &directory);  // a comment
    AppendLittleEndian(std::uint32_t{0}, &directory);
    AppendLittleEndian(std::uint32_t{0}, &directory);
    AppendLittleEndian(in_32(offset), &directory);
    directory += entry.name + std::string("\x09\x09\x01\0x", 5);
    if (options.is_long) {
      AppendLittleEndian(std::uint16_t{1}, &directory);
      AppendLittleEndian(std::uint16_t{24}, &directory);
      AppendLittleEndian(size, &directory);
      AppendLittleEndian(std::uint64_t{stored.size()}, &directory);
      AppendLittleEndian(offset, &directory);
    }
    directory += "hi";
  }
  const std::uint64_t start = file.size();
  const std::uint64_t count = entries.size();
  file += directory;
  if (options.is_long) {
    const std::uint64_t end = file.size();
    file += std::string("PK\x06\x06", 4);
    AppendLittleEndian(std::uint64_t{44}, &file);
    AppendLittleEndian(std::uint32_t{45 << 16 | 45}, &file);
    AppendLittleEndian(std::uint32_t{0}, &file);
    AppendLittleEndian(std::uint32_t{0}, &file);
    for (const std::uint64_t number : {count, count, std::uint64_t{directory.size()}, start}) {
      AppendLittleEndian(number, &file);
    }
    file += std::string("PK\x06\x07", 4);
    AppendLittleEndian(std::uint32_t{0}, &file);
    AppendLittleEndian(end, &file);
    AppendLittleEndian(std::uint32_t{1}, &file);
  }
  file += std::string("PK\x05\x06", 4);
  AppendLittleEndian(std::uint32_t{0}, &file);
  for (int i = 0; i < 2; ++i) {
    AppendLittleEndian(static_cast<std::uint16_t>(options.is_long ? 0xffff : count), &file);
  }
  AppendLittleEndian(static_cast<std::uint32_t>(options.is_long ? 0xffffffff : directory.size()),
                     &file);
  AppendLittleEndian(static_cast<std::uint32_t>(options.is_long ? 0xffffffff : start), &file);
  AppendLittleEndian(static_cast<std::uint16_t>(options.comment.size()), &file);
  return file + options.comment;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_SOURCE_BYTES_ZIP_BYTES_H_
