#include "clients/cpp/picture_file/npy_writer.h"

#include <cstddef>
#include <cstdint>
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/io/atomic_file.h"

namespace isoscope::client {

std::string MakeNpyHeader(absl::string_view type, const std::vector<int>& shape) {
  constexpr absl::string_view kMagic("\x93NUMPY\x01\x00", 8);
  constexpr std::size_t kAlignment = 64;
  std::string dictionary =
      absl::StrCat("{'descr': '", type, "', 'fortran_order': False, 'shape': (",
                   absl::StrJoin(shape, ", "), shape.size() == 1 ? ",), }" : "), }");
  const std::size_t begin = kMagic.size() + sizeof(std::uint16_t);
  const std::size_t size = begin + dictionary.size() + 1;  // a line feed ends it
  dictionary.append((kAlignment - size % kAlignment) % kAlignment, ' ');
  dictionary += '\n';
  std::string header(kMagic);
  base::AppendLittleEndian(static_cast<std::uint16_t>(dictionary.size()), &header);
  return header + dictionary;
}

absl::Status WriteNpy(const std::string& path, absl::string_view type, int element_bytes,
                      const std::vector<int>& shape, absl::string_view elements) {
  std::size_t expected = static_cast<std::size_t>(element_bytes);
  for (const int side : shape) {
    expected *= static_cast<std::size_t>(side);
  }
  if (elements.size() != expected) {
    return absl::DataLossError(absl::StrCat(
        "the server sent ", elements.size(), " bytes for the plane '", path, "', expected ",
        expected, ": it may be older than this program, and not know planes"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::AtomicFile> file,
                            io::AtomicFile::Create(path));
  ISOSCOPE_RETURN_IF_ERROR(file->Append(MakeNpyHeader(type, shape)));
  ISOSCOPE_RETURN_IF_ERROR(file->Append(elements));
  return file->Commit();
}

}  // namespace isoscope::client
