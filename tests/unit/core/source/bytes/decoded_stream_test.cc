#include "core/source/bytes/decoded_stream.h"

#include <bzlib.h>

#include <memory>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::string Bzip2(std::string bytes) {
  std::string out(bytes.size() + bytes.size() / 100 + 700, '\0');
  auto size = static_cast<unsigned>(out.size());
  EXPECT_EQ(BZ2_bzBuffToBuffCompress(out.data(), &size, bytes.data(),
                                     static_cast<unsigned>(bytes.size()), 1, 0, 0),
            BZ_OK);
  return out.substr(0, size);
}

class DecodedStreamTest : public ::testing::Test {
 protected:
  std::unique_ptr<DecodedStream> Open(SampleEncoding encoding, const std::string& bytes,
                                      volume::ScalarType type = volume::ScalarType::kUint8,
                                      std::int64_t offset = 0) {
    testing::WriteFile(dir_.Sub("f"), bytes);
    file_ = io::OpenRandomAccessFile(dir_.Sub("f")).value();
    return MakeDecodedStream(encoding, type, file_.get(), offset);
  }
  // All, `run` bytes at a time.
  static absl::StatusOr<std::string> ReadAll(DecodedStream& stream, std::size_t run) {
    std::string all;
    while (true) {
      std::string part(run, '\0');
      const auto got = stream.Read(run, part.data());
      if (!got.ok()) {
        return got.status();
      }
      all += part.substr(0, *got);
      if (*got < run) {
        return all;
      }
    }
  }
  testing::TempDir dir_;
  std::unique_ptr<io::RandomAccessFile> file_;
};

TEST_F(DecodedStreamTest, AllEncodingsGiveTheBytes) {
  std::string bytes = testing::Noise({300, 20, 50}, volume::ScalarType::kUint8);
  std::string hex;
  for (const char c : bytes) {
    hex +=
        absl::StrFormat("%02x", static_cast<unsigned char>(c)) + (hex.size() % 64 < 2 ? "\n" : "");
  }
  const std::string half = bytes.substr(0, 150000);
  struct Case {
    SampleEncoding encoding;
    std::string file;
  } const cases[] = {{SampleEncoding::kDeflate, testing::Gzip(bytes)},
                     {SampleEncoding::kBzip2, Bzip2(bytes)},
                     {SampleEncoding::kBzip2, Bzip2(half) + Bzip2(bytes.substr(150000))},
                     {SampleEncoding::kBzip2, Bzip2(bytes) + std::string(100, '\0')},
                     {SampleEncoding::kHex, hex}};
  for (const Case& c : cases) {
    const auto stream = Open(c.encoding, "skip" + c.file, volume::ScalarType::kUint8, 4);
    EXPECT_EQ(ReadAll(*stream, 7919).value(), bytes);
    ISOSCOPE_EXPECT_OK(stream->VerifyEnd());
    stream->Rewind();
    EXPECT_EQ(stream->Skip(299990).value(), 299990);
    EXPECT_EQ(ReadAll(*stream, 4).value(), bytes.substr(299990));
    EXPECT_EQ(stream->position(), 300000);
    EXPECT_EQ(stream->Skip(5).value(), 0);
  }
}

TEST_F(DecodedStreamTest, NumbersAsText) {
  const auto read = [&](const std::string& text, volume::ScalarType type) {
    return ReadAll(*Open(SampleEncoding::kText, text, type), 2 * volume::SizeOf(type));
  };
  EXPECT_EQ(read("-7 260\n\t1e3,5.0\r\n", volume::ScalarType::kInt16).value(),
            BytesOf<std::int16_t>({-7, 260, 1000, 5}));
  EXPECT_EQ(read("0.1 -2e-3", volume::ScalarType::kFloat32).value(),
            BytesOf<float>({0.1F, -2e-3F}));
  EXPECT_EQ(read("4294967295", volume::ScalarType::kUint32).value(),
            BytesOf<std::uint32_t>({4294967295U}));
  EXPECT_EQ(read("", volume::ScalarType::kFloat64).value(), "");
  constexpr auto kDamaged = absl::StatusCode::kDataLoss;
  EXPECT_THAT(read("1 2 256", volume::ScalarType::kUint8),
              StatusIs(kDamaged, AllOf(HasSubstr("sample 2 is \"256\""), HasSubstr("uint8"))));
  EXPECT_THAT(read("1 2.5", volume::ScalarType::kInt32), StatusIs(kDamaged, HasSubstr("2.5")));
  EXPECT_THAT(read("1 zwei", volume::ScalarType::kFloat32), StatusIs(kDamaged, HasSubstr("zwei")));
  EXPECT_THAT(read("1 \033[2J", volume::ScalarType::kFloat32),
              StatusIs(kDamaged, HasSubstr("?[2J")));
  EXPECT_THAT(read(std::string(100000, '1'), volume::ScalarType::kFloat32),
              StatusIs(kDamaged, HasSubstr("111")));
}

TEST_F(DecodedStreamTest, DamageAndCutsAreErrors) {
  const std::string bytes = testing::Noise({100, 20, 10}, volume::ScalarType::kUint8);
  std::string packed = Bzip2(bytes);
  for (const std::size_t size : {std::size_t{0}, packed.size() / 2, packed.size() - 5}) {
    const auto stream = Open(SampleEncoding::kBzip2, packed.substr(0, size));
    const auto all = ReadAll(*stream, 1000);
    EXPECT_TRUE(!all.ok() || *all != bytes || !stream->VerifyEnd().ok()) << size;
  }
  packed[packed.size() / 2] ^= 1;
  EXPECT_THAT(ReadAll(*Open(SampleEncoding::kBzip2, packed), 1000),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("bzip2")));
  EXPECT_THAT(ReadAll(*Open(SampleEncoding::kBzip2, "no stream"), 1000),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("bzip2")));
  EXPECT_THAT(ReadAll(*Open(SampleEncoding::kHex, "00 f"), 1),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("two hexadecimal digits")));
}

}  // namespace
}  // namespace isoscope::source
