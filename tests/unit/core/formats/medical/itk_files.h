// Images that ITK writes.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_FORMATS_MEDICAL_ITK_FILES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_FORMATS_MEDICAL_ITK_FILES_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "itkImageIOBase.h"

#include "core/source/volume_source.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::testing {

// Writes an image with ITK; `samples` in the order of the file.
template <typename Io, typename T>
void WriteImage(const std::string& path, const std::vector<unsigned>& dims,
                const std::vector<T>& samples, unsigned components = 1) {
  const auto io = Io::New();
  const auto axes = static_cast<unsigned>(dims.size());
  io->SetFileName(path);
  io->SetNumberOfDimensions(axes);
  itk::ImageIORegion region(axes);
  for (unsigned axis = 0; axis < axes; ++axis) {
    io->SetDimensions(axis, dims[axis]);
    io->SetSpacing(axis, 0.5 * (axis + 1));
    io->SetOrigin(axis, 0);
    region.SetSize(axis, dims[axis]);
    region.SetIndex(axis, 0);
  }
  io->SetComponentType(sizeof(T) == 1 ? itk::IOComponentEnum::UCHAR : itk::IOComponentEnum::USHORT);
  io->SetNumberOfComponents(components);
  io->SetPixelType(components == 1 ? itk::IOPixelEnum::SCALAR : itk::IOPixelEnum::RGB);
  io->SetIORegion(region);
  io->WriteImageInformation();
  io->Write(samples.data());
}

template <typename T>
std::vector<T> Counted(std::size_t count, int first = 0) {
  std::vector<T> samples;
  for (std::size_t i = 0; i < count; ++i) {
    samples.push_back(static_cast<T>(static_cast<int>(i) * (sizeof(T) == 1 ? 1 : 257) + first));
  }
  return samples;
}

template <typename T>
std::vector<T> SamplesOf(source::VolumeSource& source, std::int64_t planes) {
  const auto bytes = ReadAll(source, planes);
  EXPECT_TRUE(bytes.ok()) << bytes.status();
  return bytes.ok() ? ValuesOf<T>(*bytes) : std::vector<T>();
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_FORMATS_MEDICAL_ITK_FILES_H_
