// The type of a dataset decides the type of its samples, and the type that H5Dread is asked for:
//
//   stored                             samples                    read as
//   integer of 1, 2 or 4 bytes         the same integer           the same, little-endian
//   integer of 8 bytes                 float64 (wide_source.h)    the same, little-endian
//   IEEE float of 4 or 8 bytes         the same float             the same, little-endian
//   IEEE float of 2 bytes              float32 (wide_source.h)    the same, little-endian
//   enumeration of h5py's bool         uint8                      uint8
//   other enumeration                  as its integer             as its integer
//   bit field of 1, 2, 4 or 8 bytes    as an unsigned integer     the same, little-endian
//
// Other types are refused by a name that people know (Hdf5TypeName). Source: "HDF5 File Format
// Specification", the message "Datatype".

#include "core/formats/hdf5/hdf5_types.h"

#include <cstddef>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace isoscope::source {
namespace {

// The integer of that size in bytes; `wide` is set for 8.
bool IntegerOf(std::size_t size, bool is_signed, Hdf5SampleType* type) {
  using volume::ScalarType;
  switch (size) {
    case 1:
      type->scalar = is_signed ? ScalarType::kInt8 : ScalarType::kUint8;
      return true;
    case 2:
      type->scalar = is_signed ? ScalarType::kInt16 : ScalarType::kUint16;
      return true;
    case 4:
      type->scalar = is_signed ? ScalarType::kInt32 : ScalarType::kUint32;
      return true;
    case 8:
      type->wide = is_signed ? WideType::kInt64 : WideType::kUint64;
      type->scalar = CarrierType(*type->wide);
      return true;
    default:
      return false;
  }
}

hid_t MemoryIntegerOf(const Hdf5SampleType& type) {
  if (type.wide.has_value()) {
    return *type.wide == WideType::kInt64 ? H5T_STD_I64LE : H5T_STD_U64LE;
  }
  switch (type.scalar) {
    case volume::ScalarType::kUint8:
      return H5T_STD_U8LE;
    case volume::ScalarType::kInt8:
      return H5T_STD_I8LE;
    case volume::ScalarType::kUint16:
      return H5T_STD_U16LE;
    case volume::ScalarType::kInt16:
      return H5T_STD_I16LE;
    case volume::ScalarType::kUint32:
      return H5T_STD_U32LE;
    default:
      return H5T_STD_I32LE;
  }
}

bool IsOneOf(hid_t type, hid_t little, hid_t big) {
  return H5Tequal(type, little) > 0 || H5Tequal(type, big) > 0;
}

// IEEE 754 binary16: sign, 5 bits of exponent with the bias 15, 10 of fraction.
bool IsHalf(hid_t type) {
  std::size_t sign = 0;
  std::size_t exponent = 0;
  std::size_t exponent_bits = 0;
  std::size_t fraction = 0;
  std::size_t fraction_bits = 0;
  const H5T_order_t order = H5Tget_order(type);
  return H5Tget_class(type) == H5T_FLOAT && H5Tget_size(type) == 2 &&
         H5Tget_precision(type) == 16 && H5Tget_offset(type) == 0 &&
         H5Tget_fields(type, &sign, &exponent, &exponent_bits, &fraction, &fraction_bits) >= 0 &&
         sign == 15 && exponent == 10 && exponent_bits == 5 && fraction == 0 &&
         fraction_bits == 10 && H5Tget_ebias(type) == 15 && H5Tget_norm(type) == H5T_NORM_IMPLIED &&
         (order == H5T_ORDER_LE || order == H5T_ORDER_BE);
}

// Those of IEEE alone: what the library makes of other bits depends on how much is read at once.
bool FloatOf(hid_t stored, Hdf5SampleType* type) {
  if (IsOneOf(stored, H5T_IEEE_F32LE, H5T_IEEE_F32BE)) {
    type->scalar = volume::ScalarType::kFloat32;
    type->memory_type = Hdf5Handle(H5Tcopy(H5T_IEEE_F32LE), H5Tclose);
  } else if (IsOneOf(stored, H5T_IEEE_F64LE, H5T_IEEE_F64BE)) {
    type->scalar = volume::ScalarType::kFloat64;
    type->memory_type = Hdf5Handle(H5Tcopy(H5T_IEEE_F64LE), H5Tclose);
  } else if (IsHalf(stored)) {
    type->wide = WideType::kFloat16;
    type->scalar = CarrierType(*type->wide);
    type->memory_type = Hdf5Handle(H5Tcopy(stored), H5Tclose);
    H5Tset_order(type->memory_type.get(), H5T_ORDER_LE);
  }
  return type->memory_type.is_valid();
}

std::vector<std::string> MemberNames(hid_t type) {
  constexpr int kMaxNames = 8;
  const int count = H5Tget_nmembers(type);
  std::vector<std::string> names;
  for (int i = 0; i < count && i < kMaxNames; ++i) {
    char* const name = H5Tget_member_name(type, static_cast<unsigned int>(i));
    names.emplace_back(name != nullptr ? name : "");
    H5free_memory(name);
  }
  if (count > kMaxNames) {
    names.emplace_back("...");
  }
  return names;
}

// h5py's bool is an enumeration of one byte with FALSE and TRUE.
bool IsBool(hid_t type) {
  const std::vector<std::string> names = MemberNames(type);
  return H5Tget_size(type) == 1 && names.size() == 2 &&
         absl::AsciiStrToUpper(names[0]) == "FALSE" && absl::AsciiStrToUpper(names[1]) == "TRUE";
}

bool SampleTypeOf(hid_t stored, Hdf5SampleType* type) {
  switch (H5Tget_class(stored)) {
    case H5T_FLOAT:
      return FloatOf(stored, type);
    case H5T_INTEGER:
      if (IntegerOf(H5Tget_size(stored), H5Tget_sign(stored) == H5T_SGN_2, type)) {
        type->memory_type = Hdf5Handle(H5Tcopy(MemoryIntegerOf(*type)), H5Tclose);
      }
      return type->memory_type.is_valid();
    case H5T_ENUM: {
      // The library converts enumerations to integers.
      if (IsBool(stored)) {
        type->memory_type = Hdf5Handle(H5Tcopy(H5T_STD_U8LE), H5Tclose);
        return type->memory_type.is_valid();
      }
      const Hdf5Handle integer(H5Tget_super(stored), H5Tclose);
      return H5Tget_class(integer.get()) == H5T_INTEGER && SampleTypeOf(integer.get(), type);
    }
    case H5T_BITFIELD:
      if (IntegerOf(H5Tget_size(stored), false, type)) {
        type->memory_type = Hdf5Handle(H5Tcopy(stored), H5Tclose);
        H5Tset_order(type->memory_type.get(), H5T_ORDER_LE);
      }
      return type->memory_type.is_valid();
    default:
      return false;
  }
}

// Two floats of one type, as h5py, MATLAB and Julia write complex numbers.
bool IsComplex(hid_t type, const std::vector<std::string>& names) {
  if (names.size() != 2) {
    return false;
  }
  const std::string first = absl::AsciiStrToLower(names[0]);
  const std::string second = absl::AsciiStrToLower(names[1]);
  const Hdf5Handle real(H5Tget_member_type(type, 0), H5Tclose);
  return H5Tget_class(real.get()) == H5T_FLOAT &&
         ((first == "r" && second == "i") || (first == "re" && second == "im") ||
          (first == "real" && second == "imag"));
}

std::string CompoundName(hid_t type) {
  const std::vector<std::string> names = MemberNames(type);
  const Hdf5Handle first(H5Tget_member_type(type, 0), H5Tclose);
  return IsComplex(type, names) ? absl::StrCat("complex numbers of ", Hdf5TypeName(first.get()))
                                : absl::StrCat("compounds (", absl::StrJoin(names, ", "), ")");
}

std::string EnumerationName(hid_t type) {
  const Hdf5Handle integer(H5Tget_super(type), H5Tclose);
  return IsBool(type) ? "bool" : absl::StrCat("an enumeration in ", Hdf5TypeName(integer.get()));
}

}  // namespace

std::string Hdf5TypeName(hid_t type) {
  const std::size_t bits = 8 * H5Tget_size(type);
  switch (H5Tget_class(type)) {
    case H5T_INTEGER:
      return absl::StrCat(H5Tget_sign(type) == H5T_SGN_2 ? "int" : "uint", bits);
    case H5T_FLOAT: {
      Hdf5SampleType sample;
      return absl::StrCat("float", bits, FloatOf(type, &sample) ? "" : ", not of IEEE");
    }
    case H5T_STRING:
      return "texts";
    case H5T_BITFIELD:
      return absl::StrCat("bit fields of ", bits, " bits");
    case H5T_OPAQUE:
      return "opaque bytes";
    case H5T_COMPOUND:
      return CompoundName(type);
    case H5T_REFERENCE:
      return "references";
    case H5T_ENUM:
      return EnumerationName(type);
    case H5T_VLEN:
    case H5T_ARRAY: {
      const Hdf5Handle element(H5Tget_super(type), H5Tclose);
      return absl::StrCat(H5Tget_class(type) == H5T_VLEN ? "lists of " : "arrays of ",
                          Hdf5TypeName(element.get()));
    }
    default:
      return absl::StrCat("a type of class ", static_cast<int>(H5Tget_class(type)));
  }
}

absl::StatusOr<Hdf5SampleType> Hdf5SampleTypeOf(hid_t dataset) {
  const Hdf5Handle stored(H5Dget_type(dataset), H5Tclose);
  Hdf5SampleType type;
  if (!SampleTypeOf(stored.get(), &type)) {
    return absl::InvalidArgumentError(absl::StrCat("its elements are ", Hdf5TypeName(stored.get()),
                                                   "; expected integers of 8, 16, 32 or 64 bits, "
                                                   "bool or an enumeration, or IEEE floats of 16, "
                                                   "32 or 64 bits"));
  }
  return type;
}

bool IsPlainHdf5Type(hid_t dataset) {
  const Hdf5Handle stored(H5Dget_type(dataset), H5Tclose);
  const H5T_class_t kind = H5Tget_class(stored.get());
  Hdf5SampleType type;
  return (kind == H5T_INTEGER || kind == H5T_FLOAT) && SampleTypeOf(stored.get(), &type) &&
         !type.wide.has_value();
}

}  // namespace isoscope::source
