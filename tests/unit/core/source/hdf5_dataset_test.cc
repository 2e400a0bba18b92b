#include "core/source/hdf5_dataset.h"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "hdf5.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/source/vti_bytes.h"

// libhdf5 does not free what it had read of a file that it then refuses.
extern "C" const char* __lsan_default_suppressions() { return "leak:libhdf5"; }

namespace isoscope::source {
namespace {

using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::ValuesOf;
using ::isoscope::testing::WriteHdf5Dataset;
using ::testing::AllOf;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class Hdf5DatasetTest : public ::testing::Test {
 protected:
  void Create() {
    file_ = Hdf5Handle(H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
  }
  TempDir dir_;
  const std::string path_ = dir_.Sub("a.h5");
  Hdf5Handle file_;
  const std::vector<float> zeros_ = std::vector<float>(1000, 0);
};

TEST_F(Hdf5DatasetTest, PathWithoutANameMeansTheOnlyOne) {
  Create();
  WriteHdf5Dataset(file_.get(), "u", {2, 3, 4, 5}, H5T_IEEE_F32LE, zeros_.data());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto u, OpenHdf5ByName(path_, Hdf5Types::kAll));
  EXPECT_EQ(u.parts.name(), path_ + ":/u");
  EXPECT_THAT(Hdf5DimsOf(u.dataset.get()), ElementsAre(2, 3, 4, 5));
  EXPECT_THAT(OpenHdf5ByName(path_, Hdf5Types::kOfVolumes),
              StatusIs(kInvalid, HasSubstr("no three-dim")));
  WriteHdf5Dataset(file_.get(), "volume", {2, 3, 4}, H5T_IEEE_F32LE, zeros_.data());
  WriteHdf5Dataset(file_.get(), "wide", {2, 3, 4}, H5T_STD_I64LE, zeros_.data());
  for (const Hdf5Types types : {Hdf5Types::kAll, Hdf5Types::kOfVolumes}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenHdf5ByName(path_, types));
    EXPECT_EQ(volume.parts.dataset, "/volume") << "what has always been opened";
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto four, OpenHdf5ByName(path_, Hdf5Types::kAll, 4));
  EXPECT_EQ(four.parts.dataset, "/u");
  WriteHdf5Dataset(file_.get(), "v", {2, 3, 4, 5}, H5T_IEEE_F32LE, zeros_.data());
  EXPECT_THAT(OpenHdf5ByName(path_, Hdf5Types::kAll, 4), StatusIs(kInvalid, HasSubstr("/u, /v")));
  EXPECT_THAT(OpenHdf5ByName(path_ + ":/w", Hdf5Types::kAll, 4),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("/u, /v")));
  EXPECT_EQ(ListHdf5Volumes(file_.get()), "it holds /volume");
}

TEST_F(Hdf5DatasetTest, WideTypesAreThoseOfSeriesAlone) {
  Create();
  const Hdf5Handle half(H5Tcopy(H5T_IEEE_F32LE), H5Tclose);
  H5Tset_fields(half.get(), 15, 10, 5, 0, 10);
  H5Tset_size(half.get(), 2);
  H5Tset_ebias(half.get(), 15);
  const Hdf5Handle big_half(H5Tcopy(half.get()), H5Tclose);
  H5Tset_order(big_half.get(), H5T_ORDER_BE);
  const Hdf5Handle odd_half(H5Tcopy(half.get()), H5Tclose);
  H5Tset_ebias(odd_half.get(), 14);
  const Hdf5Handle boolean(H5Tenum_create(H5T_STD_I8LE), H5Tclose);
  const Hdf5Handle colours(H5Tenum_create(H5T_STD_I8LE), H5Tclose);
  for (const char value : {'\0', '\1'}) {
    H5Tenum_insert(boolean.get(), value == 0 ? "FALSE" : "TRUE", &value);
    H5Tenum_insert(colours.get(), value == 0 ? "RED" : "GREEN", &value);
  }
  // 1 and 7 as int64, 1.0 as halves of both orders, TRUE.
  const std::vector<std::int64_t> ones(8, 1);
  const std::vector<std::uint16_t> halves(8, 0x3c00);
  const std::vector<std::uint16_t> swapped(8, 0x003c);
  const std::vector<std::int8_t> truths(8, 1);
  struct Row {
    const char* name;
    hid_t type;
    const void* samples;
    volume::ScalarType served;
  };
  const std::vector<Row> rows{
      {"i64", H5T_STD_I64LE, ones.data(), volume::ScalarType::kFloat64},
      {"u64", H5T_STD_U64LE, ones.data(), volume::ScalarType::kFloat64},
      {"f16", half.get(), halves.data(), volume::ScalarType::kFloat32},
      {"f16be", big_half.get(), swapped.data(), volume::ScalarType::kFloat32},
      {"bool", boolean.get(), truths.data(), volume::ScalarType::kUint8},
      {"f32", H5T_IEEE_F32LE, zeros_.data(), volume::ScalarType::kFloat32}};
  for (const Row& row : rows) {
    WriteHdf5Dataset(file_.get(), row.name, {2, 2, 2}, row.type, row.samples);
  }
  WriteHdf5Dataset(file_.get(), "odd", {2, 2, 2}, odd_half.get(), halves.data());
  WriteHdf5Dataset(file_.get(), "colours", {2, 2, 2}, colours.get(), truths.data());
  for (const Row& row : rows) {
    SCOPED_TRACE(row.name);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto named,
                                  OpenHdf5ByName(path_ + ":/" + row.name, Hdf5Types::kAll));
    if (std::string(row.name) != "f32") {
      EXPECT_THAT(Hdf5SampleTypeOf(named.dataset.get(), Hdf5Types::kOfVolumes).status(),
                  StatusIs(kInvalid, HasSubstr("8, 16 or 32 bits or IEEE floats of 32 or 64")));
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto type,
                                  Hdf5SampleTypeOf(named.dataset.get(), Hdf5Types::kAll));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto source,
        OpenHdf5Volume(std::move(named), std::move(type), {.z = 0, .y = 1, .x = 2}, 0, 0));
    ASSERT_EQ(source->scalar_type(), row.served);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*source, 1));
    switch (row.served) {
      case volume::ScalarType::kFloat64:
        EXPECT_THAT(ValuesOf<double>(bytes), Each(1.0));
        break;
      case volume::ScalarType::kUint8:
        EXPECT_EQ(bytes, std::string(8, '\1'));
        break;
      default:
        EXPECT_THAT(ValuesOf<float>(bytes), Each(row.samples == zeros_.data() ? 0.0F : 1.0F));
    }
  }
  for (const char* name : {"odd", "colours"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto named,
                                  OpenHdf5ByName(path_ + ":/" + name, Hdf5Types::kAll));
    EXPECT_THAT(Hdf5SampleTypeOf(named.dataset.get(), Hdf5Types::kAll).status(),
                StatusIs(kInvalid, AllOf(HasSubstr("bool"), HasSubstr("16, 32 or 64 bits"))));
  }
}

}  // namespace
}  // namespace isoscope::source
