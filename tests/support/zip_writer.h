// Writes ZIP archives, Zip64 on demand.

#ifndef ISOSCOPE_TESTS_SUPPORT_ZIP_WRITER_H_
#define ISOSCOPE_TESTS_SUPPORT_ZIP_WRITER_H_

#include <cstdint>
#include <string>

#include "core/base/coding.h"
#include "tests/support/volume_files.h"
#include "zlib.h"

namespace isoscope::testing {

class ZipWriter {
 public:
  // is_64: all sizes and places stand in extra fields.
  explicit ZipWriter(bool is_64 = false) : is_64_(is_64) {}

  void Add(const std::string& name, const std::string& bytes, bool is_deflated,
           std::uint16_t flags = 0) {
    const std::string packed = is_deflated ? Deflate(bytes, -15) : bytes;
    const auto method = static_cast<std::uint16_t>(is_deflated ? 8 : 0);
    Write(name, bytes, packed, method, flags);
  }
  void Write(const std::string& name, const std::string& bytes, const std::string& packed,
             std::uint16_t method, std::uint16_t flags) {
    const auto crc = static_cast<std::uint32_t>(
        crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
    const std::uint64_t place = archive_.size();
    const std::string local_extra("\x99\x99\x02\x00xy", 6);
    const std::string extra_head("\x99\x99\x00\x00", 4);
    Numbers(&archive_, std::uint32_t{0x04034b50}, std::uint16_t{20}, flags, method,
            std::uint32_t{0}, crc, Size(packed.size()), Size(bytes.size()),
            static_cast<std::uint16_t>(name.size()), std::uint16_t{6});
    archive_ += name + local_extra + packed;
    std::string extra = extra_head;
    if (is_64_) {
      Numbers(&extra, std::uint16_t{1}, std::uint16_t{24}, std::uint64_t{bytes.size()},
              std::uint64_t{packed.size()}, place);
    }
    Numbers(&directory_, std::uint32_t{0x02014b50}, std::uint16_t{20}, std::uint16_t{20}, flags,
            method, std::uint32_t{0}, crc, Size(packed.size()), Size(bytes.size()),
            static_cast<std::uint16_t>(name.size()), static_cast<std::uint16_t>(extra.size()),
            std::uint16_t{1}, std::uint16_t{0}, std::uint16_t{0}, std::uint32_t{0}, Size(place));
    directory_ += name + extra + "c";
    ++count_;
  }
  [[nodiscard]] std::string Finish(const std::string& comment = "OZX") const {
    std::string all = archive_ + directory_;
    const std::uint64_t end = all.size();
    if (is_64_) {
      Numbers(&all, std::uint32_t{0x06064b50}, std::uint64_t{44}, std::uint16_t{45},
              std::uint16_t{45}, std::uint32_t{0}, std::uint32_t{0}, std::uint64_t{count_},
              std::uint64_t{count_}, std::uint64_t{directory_.size()},
              std::uint64_t{archive_.size()});
      Numbers(&all, std::uint32_t{0x07064b50}, std::uint32_t{0}, end, std::uint32_t{1});
    }
    Numbers(&all, std::uint32_t{0x06054b50}, std::uint16_t{0}, std::uint16_t{0},
            static_cast<std::uint16_t>(count_), static_cast<std::uint16_t>(count_),
            Size(directory_.size()), Size(archive_.size()),
            static_cast<std::uint16_t>(comment.size()));
    return all + comment;
  }

 private:
  template <typename... T>
  static void Numbers(std::string* out, T... numbers) {
    (base::AppendLittleEndian(numbers, out), ...);
  }
  [[nodiscard]] std::uint32_t Size(std::uint64_t size) const {
    return is_64_ ? 0xffffffffU : static_cast<std::uint32_t>(size);
  }

  const bool is_64_;
  std::string archive_;
  std::string directory_;
  std::uint32_t count_ = 0;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_ZIP_WRITER_H_
