#include "client-cli/obj_writer.h"

#include <array>
#include <charconv>
#include <cstddef>
#include <string>

#include "absl/strings/str_cat.h"

#include "client-cli/sectioned_file.h"
#include "core/base/status_macros.h"

namespace isoscope::cli {
namespace {

constexpr char kHeader[] = "# isoscope\n";
constexpr std::size_t kTypicalLineBytes = 40;

template <typename T>
void AppendNumber(T value, std::string* out) {
  std::array<char, 32> text;
  const std::to_chars_result end = std::to_chars(text.data(), text.data() + text.size(), value);
  out->append(text.data(), end.ptr);
}

void AppendVector(absl::string_view word, const float* v, absl::string_view rest,
                  std::string* out) {
  out->append(word.data(), word.size());
  for (int k = 0; k < 3; ++k) {
    out->push_back(' ');
    AppendNumber(v[k], out);
  }
  out->append(rest.data(), rest.size());
}

class ObjWriter : public MeshWriter {
 public:
  explicit ObjWriter(const MeshFileOptions& options) {
    if (options.color) {
      const std::array<float, 3> rgb{options.color->red, options.color->green, options.color->blue};
      AppendVector("", rgb.data(), "", &color_);
    }
    color_ += "\n";
  }

  absl::Status Open(const std::string& path) {
    ISOSCOPE_ASSIGN_OR_RETURN(file_, SectionedFile::Create(path, sizeof(kHeader) - 1, 1));
    return absl::OkStatus();
  }

  // A line may name any vertex before it, so one pass is enough.
  absl::Status AddPiece(const MeshPiece& piece) override {
    std::string text;
    text.reserve((2 * piece.positions.size() / 3 + piece.triangles.size() / 3) * kTypicalLineBytes);
    for (std::size_t i = 0; i < piece.positions.size(); i += 3) {
      AppendVector("v", &piece.positions[i], color_, &text);
      AppendVector("vn", &piece.normals[i], "\n", &text);
    }
    for (std::size_t i = 0; i < piece.triangles.size(); ++i) {
      text += i % 3 == 0 ? "f " : " ";
      AppendNumber(std::size_t{piece.triangles[i]} + 1, &text);
      text += "//";
      AppendNumber(std::size_t{piece.triangles[i]} + 1, &text);
      if (i % 3 == 2) {
        text += "\n";
      }
    }
    return file_->Append(0, text);
  }

  absl::Status Finish() override { return file_->Finish(kHeader); }

  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }

 private:
  std::string color_;  // the end of a line of a vertex
  std::unique_ptr<SectionedFile> file_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<MeshWriter>> CreateObj(const MeshFileOptions& options) {
  auto writer = std::make_unique<ObjWriter>(options);
  ISOSCOPE_RETURN_IF_ERROR(writer->Open(options.path));
  return writer;
}

}  // namespace isoscope::cli
