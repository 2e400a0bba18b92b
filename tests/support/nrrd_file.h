// Reads the NRRD files of the shared data folder (gzip or raw, attached, three axes): just enough
// for tests that must not depend on ingest. Throws nothing; a file that it can't read is
// std::nullopt.

#ifndef ISOSCOPE_TESTS_SUPPORT_NRRD_FILE_H_
#define ISOSCOPE_TESTS_SUPPORT_NRRD_FILE_H_

#include <zlib.h>

#include <cstdlib>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "core/io/file.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/scalar_type.h"

namespace isoscope::testing {

struct NrrdFile {
  math::Index3 dims;
  volume::ScalarType type = volume::ScalarType::kUint8;
  std::string bytes;  // [z][y][x]
};

inline std::optional<std::string> GunzipAll(const std::string& compressed, std::size_t size) {
  std::string bytes(size, '\0');
  z_stream stream{};
  if (inflateInit2(&stream, 16 + MAX_WBITS) != Z_OK) {
    return std::nullopt;
  }
  // zlib's interface is not const; it does not write to its input.
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(compressed.data()));
  stream.avail_in = static_cast<uInt>(compressed.size());
  stream.next_out = reinterpret_cast<Bytef*>(bytes.data());
  stream.avail_out = static_cast<uInt>(size);
  const int result = inflate(&stream, Z_FINISH);
  const bool is_whole = result == Z_STREAM_END && stream.total_out == size;
  inflateEnd(&stream);
  return is_whole ? std::optional<std::string>(std::move(bytes)) : std::nullopt;
}

inline std::optional<NrrdFile> ReadNrrd(const std::string& path) {
  constexpr std::int64_t kMaxFileBytes = std::int64_t{1} << 30;
  const auto content = io::ReadWholeFile(path, kMaxFileBytes);
  const std::size_t header_end = content.ok() ? content->find("\n\n") : std::string::npos;
  if (header_end == std::string::npos) {
    return std::nullopt;
  }
  NrrdFile file;
  std::string encoding;
  std::istringstream header(content->substr(0, header_end));
  for (std::string line; std::getline(header, line);) {
    const std::size_t colon = line.find(": ");
    if (colon == std::string::npos) {
      continue;
    }
    const std::string key = line.substr(0, colon);
    const std::string value = line.substr(colon + 2);
    if (key == "sizes") {
      std::istringstream(value) >> file.dims.x >> file.dims.y >> file.dims.z;
    } else if (key == "encoding") {
      encoding = value;
    } else if (key == "type") {
      const std::vector<std::pair<const char*, volume::ScalarType>> names{
          {"uint8", volume::ScalarType::kUint8},
          {"uchar", volume::ScalarType::kUint8},
          {"unsigned char", volume::ScalarType::kUint8},
          {"int16", volume::ScalarType::kInt16},
          {"short", volume::ScalarType::kInt16},
          {"uint16", volume::ScalarType::kUint16},
          {"ushort", volume::ScalarType::kUint16},
          {"unsigned short", volume::ScalarType::kUint16},
          {"float", volume::ScalarType::kFloat32},
          {"double", volume::ScalarType::kFloat64}};
      bool is_known = false;
      for (const auto& [name, type] : names) {
        if (value == name) {
          file.type = type;
          is_known = true;
        }
      }
      if (!is_known) {
        return std::nullopt;
      }
    }
  }
  const std::string data = content->substr(header_end + 2);
  const std::size_t size =
      static_cast<std::size_t>(math::Volume(file.dims)) * volume::SizeOf(file.type);
  if (encoding == "gzip" || encoding == "gz") {
    std::optional<std::string> bytes = GunzipAll(data, size);
    if (!bytes.has_value()) {
      return std::nullopt;
    }
    file.bytes = std::move(*bytes);
  } else if (encoding == "raw" && data.size() == size) {
    file.bytes = data;
  } else {
    return std::nullopt;
  }
  return file;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_NRRD_FILE_H_
