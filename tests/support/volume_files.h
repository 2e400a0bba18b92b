// Volume files made of literal bytes.

#ifndef ISOSCOPE_TESTS_SUPPORT_VOLUME_FILES_H_
#define ISOSCOPE_TESTS_SUPPORT_VOLUME_FILES_H_

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/math/vec.h"
#include "core/source/volume_source.h"
#include "core/volume/scalar_type.h"
#include "zlib.h"

namespace isoscope::testing {

inline void WriteFile(const std::string& path, const std::string& bytes) {
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  ASSERT_TRUE(out.flush().good()) << path;
}

inline std::string ReadFile(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

// window_bits 31: gzip; 15: zlib.
inline std::string Deflate(const std::string& bytes, int window_bits) {
  z_stream z{};
  EXPECT_EQ(deflateInit2(&z, 6, Z_DEFLATED, window_bits, 8, Z_DEFAULT_STRATEGY), Z_OK);
  std::string out(deflateBound(&z, bytes.size()) + 64, '\0');
  std::string in = bytes;
  z.next_in = reinterpret_cast<Bytef*>(in.data());
  z.avail_in = static_cast<uInt>(in.size());
  z.next_out = reinterpret_cast<Bytef*>(out.data());
  z.avail_out = static_cast<uInt>(out.size());
  EXPECT_EQ(deflate(&z, Z_FINISH), Z_STREAM_END);
  out.resize(z.total_out);
  deflateEnd(&z);
  return out;
}
inline std::string Gzip(const std::string& bytes) { return Deflate(bytes, 31); }

// Reverses the bytes of each sample.
inline std::string Swapped(std::string bytes, std::size_t sample_size) {
  for (std::size_t i = 0; i + sample_size <= bytes.size(); i += sample_size) {
    std::reverse(bytes.begin() + static_cast<std::ptrdiff_t>(i),
                 bytes.begin() + static_cast<std::ptrdiff_t>(i + sample_size));
  }
  return bytes;
}

// Bytes without a pattern, but no NaN or infinity in any sample type.
inline std::string Noise(const math::Index3& dims, volume::ScalarType type) {
  std::string bytes(static_cast<std::size_t>(math::Volume(dims)) * volume::SizeOf(type), '\0');
  std::uint32_t state = 12345;
  for (char& byte : bytes) {
    state = state * 1664525u + 1013904223u;
    byte = static_cast<char>(state >> 24);
  }
  const bool is_float =
      type == volume::ScalarType::kFloat32 || type == volume::ScalarType::kFloat64;
  const std::size_t size = volume::SizeOf(type);
  for (std::size_t i = size - 1; is_float && i < bytes.size(); i += size) {
    bytes[i] = static_cast<char>(bytes[i] & 0xbf);  // top exponent bit off: |value| < 2
  }
  return bytes;
}

struct NiftiHeader {
  math::Index3 dims;
  std::int16_t dim_count = 3;
  std::int16_t dim4 = 1;
  std::int16_t datatype = 4;
  float slope = 0;
  float intercept = 0;
  bool is_pair = false;
  bool is_big_endian = false;
  float vox_offset = 352;
};

// Header (and 4 bytes of "no extensions"), with an oblique sform: RAS rows
// (0, -2, 0, 10), (1.5, 0, 0, 20), (0, 0, 3, 30).
inline std::string NiftiHeaderBytes(const NiftiHeader& h) {
  std::string b(352, '\0');
  const auto put = [&](std::size_t offset, auto value) {
    std::memcpy(b.data() + offset, &value, sizeof(value));
    if (h.is_big_endian) {
      std::reverse(b.begin() + static_cast<std::ptrdiff_t>(offset),
                   b.begin() + static_cast<std::ptrdiff_t>(offset + sizeof(value)));
    }
  };
  put(0, std::int32_t{348});
  put(40, h.dim_count);
  put(42, static_cast<std::int16_t>(h.dims.x));
  put(44, static_cast<std::int16_t>(h.dims.y));
  put(46, static_cast<std::int16_t>(h.dims.z));
  put(48, h.dim4);
  for (std::size_t i = 5; i < 8; ++i) {
    put(40 + 2 * i, std::int16_t{1});
  }
  std::int16_t bits = 16;
  switch (h.datatype) {
    case 2:
    case 256:
      bits = 8;
      break;
    case 8:
    case 16:
    case 768:
      bits = 32;
      break;
    case 64:
    case 1024:
    case 1280:
      bits = 64;
      break;
    case 128:
      bits = 24;
      break;
    default:
      break;
  }
  put(70, h.datatype);
  put(72, bits);
  put(76, 1.0F);
  put(80, 1.5F);
  put(84, 2.0F);
  put(88, 3.0F);
  put(92, 1.0F);
  put(108, h.is_pair ? 0.0F : h.vox_offset);
  put(112, h.slope);
  put(116, h.intercept);
  b[123] = 10;                // millimetres, seconds
  put(254, std::int16_t{1});  // sform_code
  const float rows[3][4] = {{0, -2, 0, 10}, {1.5, 0, 0, 20}, {0, 0, 3, 30}};
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 4; ++column) {
      put(280 + 16 * row + 4 * column, rows[row][column]);
    }
  }
  std::memcpy(b.data() + 344, h.is_pair ? "ni1" : "n+1", 4);
  return b;
}

// An NRRD header up to its empty line, in LPS, oblique: axis x along world y. `more` holds further
// lines ("data file: a.raw\n").
inline std::string NrrdHeader(const math::Index3& dims, const std::string& type,
                              const std::string& encoding, const std::string& more = "",
                              const std::string& endian = "little") {
  return absl::StrCat("NRRD0004\n# comment: not a field\ntype: ", type,
                      "\ndimension: 3\nspace: left-posterior-superior\nsizes: ", dims.x, " ",
                      dims.y, " ", dims.z,
                      "\nspace directions: (0,1.5,0) (-2,0,0) (0,0,3)\nspace origin: (10,20,30)\n"
                      "kinds: domain domain domain\nendian: ",
                      endian, "\nencoding: ", encoding, "\n", more, "\n");
}

// A MetaImage header; `data_file` is LOCAL or a name.
inline std::string MetaHeader(const math::Index3& dims, const std::string& type,
                              const std::string& data_file, const std::string& more = "") {
  return absl::StrCat(
      "ObjectType = Image\nNDims = 3\nBinaryData = True\n", more,
      "TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 10 20 30\nElementSpacing = 1.5 2 3\n"
      "DimSize = ",
      dims.x, " ", dims.y, " ", dims.z, "\nElementType = ", type, "\nElementDataFile = ", data_file,
      "\n");
}

// All samples, read in slabs of `planes`.
inline absl::StatusOr<std::string> ReadAll(source::VolumeSource& source, std::int64_t planes) {
  const math::Index3& dims = source.info().geometry.sample_dims;
  const std::size_t plane =
      static_cast<std::size_t>(dims.x * dims.y) * volume::SizeOf(source.info().type);
  std::string samples(plane * static_cast<std::size_t>(dims.z), '\0');
  for (std::int64_t z = 0; z < dims.z; z += planes) {
    const absl::Status status = source.ReadSlab(
        z, std::min(z + planes, dims.z), samples.data() + plane * static_cast<std::size_t>(z));
    if (!status.ok()) {
      return status;
    }
  }
  return samples;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_VOLUME_FILES_H_
