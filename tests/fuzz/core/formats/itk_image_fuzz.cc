// BioRad and Stimulate, and slices in PNG, BMP, JPEG 2000 and JPEG. The first byte chooses.

#include <zlib.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

#include "core/base/coding.h"
#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

enum Kind : std::uint8_t { kBioRad, kStimulate, kPng, kBmp, kJp2, kJ2k, kJpeg, kKinds };

std::string Seed(Kind kind, const std::string& bytes) {
  return std::string(1, static_cast<char>(kind)) + bytes;
}

std::string BigEndian(std::uint32_t number) {
  return {static_cast<char>(number >> 24), static_cast<char>(number >> 16),
          static_cast<char>(number >> 8), static_cast<char>(number)};
}

std::string PngChunk(const std::string& type, const std::string& data) {
  const std::string body = type + data;
  const uLong sum =
      crc32(0, reinterpret_cast<const Bytef*>(body.data()), static_cast<uInt>(body.size()));
  return BigEndian(static_cast<std::uint32_t>(data.size())) + body +
         BigEndian(static_cast<std::uint32_t>(sum));
}

// A grey image of 4 x 3 samples of so many bits; `type` is the colour type.
std::string Png(char bits, char type) {
  const std::string rows(3 * (1 + 4 * 2 * 3), '\0');
  uLongf size = compressBound(rows.size());
  std::string packed(size, '\0');
  compress2(reinterpret_cast<Bytef*>(packed.data()), &size,
            reinterpret_cast<const Bytef*>(rows.data()), rows.size(), 9);
  packed.resize(size);
  return "\x89PNG\r\n\x1a\n" +
         PngChunk("IHDR", BigEndian(4) + BigEndian(3) + bits + type + std::string(3, '\0')) +
         PngChunk("IDAT", packed) + PngChunk("IEND", "");
}

// 4 x 3 samples of 8 bits with a palette of greys.
std::string Bmp() {
  std::string bytes = "BM";
  for (const std::uint32_t number : {1090U, 0U, 1078U, 40U, 4U, 3U}) {
    base::AppendLittleEndian(number, &bytes);
  }
  base::AppendLittleEndian(std::uint16_t{1}, &bytes);
  base::AppendLittleEndian(std::uint16_t{8}, &bytes);
  for (const std::uint32_t number : {0U, 12U, 0U, 0U, 256U, 0U}) {
    base::AppendLittleEndian(number, &bytes);
  }
  for (std::uint32_t grey = 0; grey < 256; ++grey) {
    base::AppendLittleEndian(grey * 0x10101, &bytes);
  }
  return bytes + "abcdefghijkl";
}

// A grey image of 4 x 3 samples, written with OpenJPEG, without its comment.
constexpr char kCodestream[] =
    "ff4fff510029000000000004000000030000000000000000000000040000000300000000000000000001"
    "070101ff52000c00000001000004040001ff5c00044040ff90000a00000000001d0001ff93df806006c5"
    "68dd61d812d44674fcc4ffd9";
constexpr char kBoxes[] =
    "0000000c6a5020200d0a870a00000014667479706a703220000000006a7032200000002d6a7032680000"
    "00166968647200000003000000040001070700000000000f636f6c7201000000000011000000686a7032"
    "63";
// The same as JPEG, written with libjpeg.
constexpr char kJpegImage[] =
    "ffd8ffe000104a46494600010100000100010000ffdb00430050373c463c32504641465a55505f78c882"
    "786e6e78f5afb991c8ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff"
    "ffffffffffffc0000b080003000401011100ffc40014000100000000000000000000000000000003ffc4"
    "00191000010500000000000000000000000000030001021232ffda0008010100003f00580875cb2fffd9";

std::string BioRad() {
  std::string bytes;
  for (const int number : {4, 3, 2, 0, 255}) {
    base::AppendLittleEndian(static_cast<std::int16_t>(number), &bytes);
  }
  bytes.resize(76);
  bytes[14] = 1;                                             // 8 bits
  base::StoreLittleEndian(std::int16_t{12345}, &bytes[54]);  // the mark
  return bytes + std::string(24, 'a');
}

}  // namespace

std::vector<std::string> Seeds() {
  return {Seed(kBioRad, BioRad()),
          Seed(kBioRad, BioRad().substr(0, 10) + "\1" + BioRad().substr(11, 64)),  // notes, cut
          Seed(kStimulate,
               "numDim: 3\ndim: 4 3 2\norigin: 1 2 3\ninterval: 0.5 1 1.5\ndataType: BYTE\n"),
          Seed(kStimulate, "numDim: 3\ndim: 2 2 2\nfov: 1 1 1\ndataType: WORD\n"),
          Seed(kPng, Png(8, 0)),
          Seed(kPng, Png(16, 0)),
          Seed(kPng, Png(8, 2)),
          Seed(kBmp, Bmp()),
          Seed(kJp2, absl::HexStringToBytes(absl::StrCat(kBoxes, kCodestream))),
          Seed(kJ2k, absl::HexStringToBytes(kCodestream)),
          Seed(kJpeg, absl::HexStringToBytes(kJpegImage))};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  Input input(data, size);
  const std::uint8_t kind = input.Byte() % kKinds;
  constexpr const char* kNames[] = {"v.pic",  "v.spr",  "s0.png", "s0.bmp",
                                    "s0.jp2", "s0.j2k", "s0.jpg"};
  constexpr const char* kPaths[] = {"v.pic",  "v.spr",  "s*.png", "s*.bmp",
                                    "s*.jp2", "s*.j2k", "s*.jpg"};
  const absl::string_view bytes = input.Rest();
  WriteVolumeFile(kNames[kind], bytes);
  WriteVolumeFile("v.sdt", std::string(24, 'a'));
  if (kind >= kPng) {
    WriteVolumeFile(absl::StrCat("s1", absl::string_view(kNames[kind]).substr(2)), bytes);
  }
  OpenAndReadVolume(InVolumeFolder(kPaths[kind]));
  return 0;
}
