#include "core/formats/hdf5/hdf5_types.h"

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_dataset.h"
#include "hdf5.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::ValuesOf;
using ::isoscope::testing::WriteHdf5Dataset;
using ::testing::AllOf;
using ::testing::Each;
using ::testing::HasSubstr;

Hdf5Handle HalfType() {
  Hdf5Handle half(H5Tcopy(H5T_IEEE_F32LE), H5Tclose);
  H5Tset_fields(half.get(), 15, 10, 5, 0, 10);
  H5Tset_size(half.get(), 2);
  H5Tset_ebias(half.get(), 15);
  return half;
}

template <typename T>
Hdf5Handle EnumType(hid_t integer, const std::vector<std::pair<const char*, T>>& members) {
  Hdf5Handle type(H5Tenum_create(integer), H5Tclose);
  for (const auto& [name, value] : members) {
    H5Tenum_insert(type.get(), name, &value);
  }
  return type;
}

class Hdf5TypesTest : public ::testing::Test {
 protected:
  Hdf5TypesTest()
      : file_(H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose) {
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  }
  // Writes 2 x 2 x 2 samples and reads them through the type.
  absl::StatusOr<std::string> RoundTrip(hid_t type, const void* samples,
                                        volume::ScalarType expected) {
    const std::string name = "v" + std::to_string(count_++);
    WriteHdf5Dataset(file_.get(), name, {2, 2, 2}, type, samples);
    ISOSCOPE_ASSIGN_OR_RETURN(auto named, OpenHdf5ByName(path_ + ":/" + name));
    ISOSCOPE_ASSIGN_OR_RETURN(auto sample_type, Hdf5SampleTypeOf(named.dataset.get()));
    volume::GridGeometry grid;
    grid.sample_dims = {2, 2, 2};
    ISOSCOPE_ASSIGN_OR_RETURN(const auto source,
                              OpenHdf5Volume(std::move(named), std::move(sample_type),
                                             {.z = 0, .y = 1, .x = 2}, 0, 0, grid));
    EXPECT_EQ(source->info().type, expected);
    return ReadAll(*source, 1);
  }
  // The error for a dataset of a type that is not read.
  absl::Status Refusal(hid_t type) {
    const std::string name = "v" + std::to_string(count_++);
    const std::vector<double> zeros(64, 0);
    WriteHdf5Dataset(file_.get(), name, {2, 2, 2}, type, zeros.data());
    ISOSCOPE_ASSIGN_OR_RETURN(const auto named, OpenHdf5ByName(path_ + ":/" + name));
    EXPECT_FALSE(IsPlainHdf5Type(named.dataset.get()));
    return Hdf5SampleTypeOf(named.dataset.get()).status();
  }
  TempDir dir_;
  const std::string path_ = dir_.Sub("a.h5");
  Hdf5Handle file_;
  int count_ = 0;
};

TEST_F(Hdf5TypesTest, IntegersOf64BitsAndHalvesBecomeFloats) {
  const std::vector<std::int64_t> ones(8, 1);
  for (const hid_t type : {H5T_STD_I64LE, H5T_STD_U64LE}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes,
                                  RoundTrip(type, ones.data(), volume::ScalarType::kFloat64));
    EXPECT_THAT(ValuesOf<double>(bytes), Each(1.0));
  }
  const Hdf5Handle half = HalfType();
  const Hdf5Handle big_half(H5Tcopy(half.get()), H5Tclose);
  H5Tset_order(big_half.get(), H5T_ORDER_BE);
  const std::vector<std::uint16_t> halves(8, 0x3c00);
  const std::vector<std::uint16_t> swapped(8, 0x003c);
  for (const auto& [type, samples] :
       {std::pair{half.get(), halves.data()}, std::pair{big_half.get(), swapped.data()}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes,
                                  RoundTrip(type, samples, volume::ScalarType::kFloat32));
    EXPECT_THAT(ValuesOf<float>(bytes), Each(1.0F));
  }
}

TEST_F(Hdf5TypesTest, EnumerationsAreTheIntegersThatTheyAreStoredAs) {
  const auto boolean = EnumType<std::int8_t>(H5T_STD_I8LE, {{"FALSE", 0}, {"TRUE", 1}});
  const std::vector<std::uint8_t> bytes{0, 1, 1, 0, 1, 0, 0, 1};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bools,
                                RoundTrip(boolean.get(), bytes.data(), volume::ScalarType::kUint8));
  EXPECT_EQ(ValuesOf<std::uint8_t>(bools), bytes);
  // Values that no name has are kept, too.
  const auto organs = EnumType<std::uint16_t>(H5T_STD_U16LE, {{"liver", 7}, {"spleen", 300}});
  const std::vector<std::uint16_t> labels{7, 300, 7, 0, 0, 41, 300, 65535};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::string read, RoundTrip(organs.get(), labels.data(), volume::ScalarType::kUint16));
  EXPECT_EQ(ValuesOf<std::uint16_t>(read), labels);
  const auto big = EnumType<std::uint16_t>(H5T_STD_U16BE, {{"liver", 0x0700}});
  const std::vector<std::uint16_t> swapped(8, 0x0700);  // 7 in the other order
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string sevens,
                                RoundTrip(big.get(), swapped.data(), volume::ScalarType::kUint16));
  EXPECT_THAT(ValuesOf<std::uint16_t>(sevens), Each(7));
}

TEST_F(Hdf5TypesTest, BitFieldsAreUnsignedIntegers) {
  const std::vector<std::uint8_t> bytes{0, 1, 2, 3, 128, 255, 7, 9};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read,
                                RoundTrip(H5T_STD_B8LE, bytes.data(), volume::ScalarType::kUint8));
  EXPECT_EQ(ValuesOf<std::uint8_t>(read), bytes);
}

TEST_F(Hdf5TypesTest, OtherTypesAreRefusedByName) {
  const Hdf5Handle complex(H5Tcreate(H5T_COMPOUND, 8), H5Tclose);
  H5Tinsert(complex.get(), "r", 0, H5T_IEEE_F32LE);
  H5Tinsert(complex.get(), "i", 4, H5T_IEEE_F32LE);
  const Hdf5Handle row(H5Tcreate(H5T_COMPOUND, 8), H5Tclose);
  H5Tinsert(row.get(), "id", 0, H5T_STD_I32LE);
  H5Tinsert(row.get(), "mass", 4, H5T_IEEE_F32LE);
  const hsize_t three = 3;
  const Hdf5Handle vector(H5Tarray_create2(H5T_IEEE_F32LE, 1, &three), H5Tclose);
  const Hdf5Handle text(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(text.get(), 4);
  const Hdf5Handle odd_half = HalfType();
  H5Tset_ebias(odd_half.get(), 14);
  const Hdf5Handle wide(H5Tcopy(H5T_STD_I32LE), H5Tclose);
  H5Tset_size(wide.get(), 3);
  const std::vector<std::pair<hid_t, const char*>> rows{
      {complex.get(), "complex numbers of float32"},
      {row.get(), "compounds (id, mass)"},
      {vector.get(), "arrays of float32"},
      {text.get(), "texts"},
      {odd_half.get(), "float16, not of IEEE"},
      {wide.get(), "int24"},
      {H5T_STD_REF_OBJ, "references"}};
  for (const auto& [type, name] : rows) {
    EXPECT_EQ(Hdf5TypeName(type), name);
    EXPECT_THAT(Refusal(type),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr(std::string("its elements are ") + name + ";"),
                               HasSubstr("or IEEE floats of 16, 32 or 64 bits"))));
  }
}

TEST_F(Hdf5TypesTest, NamesOfTypesThatAreRead) {
  EXPECT_EQ(Hdf5TypeName(H5T_STD_U16BE), "uint16");
  EXPECT_EQ(Hdf5TypeName(H5T_STD_I64LE), "int64");
  EXPECT_EQ(Hdf5TypeName(H5T_IEEE_F64LE), "float64");
  EXPECT_EQ(Hdf5TypeName(HalfType().get()), "float16");
  EXPECT_EQ(Hdf5TypeName(EnumType<std::int8_t>(H5T_STD_I8LE, {{"FALSE", 0}, {"TRUE", 1}}).get()),
            "bool");
  EXPECT_EQ(Hdf5TypeName(EnumType<std::int8_t>(H5T_STD_I8LE, {{"RED", 0}, {"GREEN", 1}}).get()),
            "an enumeration in int8");
  EXPECT_EQ(Hdf5TypeName(H5T_STD_B8LE), "bit fields of 8 bits");
}

}  // namespace
}  // namespace isoscope::source
