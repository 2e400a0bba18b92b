#include "core/source/child/itk_types.h"

#include <cstddef>

#include "absl/strings/str_cat.h"

namespace isoscope::source {

std::string TextOfItk(const std::exception& error) {
  const auto* const of_itk = dynamic_cast<const itk::ExceptionObject*>(&error);
  const std::string text = of_itk == nullptr ? error.what() : of_itk->GetDescription();
  const std::size_t begin = text.find("(0x");
  const std::size_t end = begin == std::string::npos ? begin : text.find("): ", begin);
  return end == std::string::npos ? text : text.substr(end + 3);
}

absl::StatusOr<volume::ScalarType> ScalarTypeOf(itk::ImageIOBase::IOComponentEnum component,
                                                const std::string& path) {
  using Component = itk::ImageIOBase::IOComponentEnum;
  switch (component) {
    case Component::UCHAR:
      return volume::ScalarType::kUint8;
    case Component::CHAR:
      return volume::ScalarType::kInt8;
    case Component::USHORT:
      return volume::ScalarType::kUint16;
    case Component::SHORT:
      return volume::ScalarType::kInt16;
    case Component::UINT:
      return volume::ScalarType::kUint32;
    case Component::INT:
      return volume::ScalarType::kInt32;
    case Component::FLOAT:
      return volume::ScalarType::kFloat32;
    case Component::DOUBLE:
      return volume::ScalarType::kFloat64;
    default:
      return absl::InvalidArgumentError(absl::StrCat(
          path, ": samples of type ", itk::ImageIOBase::GetComponentTypeAsString(component),
          "; expected (u)int8, (u)int16, (u)int32, float32 or float64: convert the file to one of "
          "them"));
  }
}

}  // namespace isoscope::source
