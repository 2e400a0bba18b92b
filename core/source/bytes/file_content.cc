// Its first bytes are a mark at some place, or a text that they begin with. A gzip stream is
// described by what is in it.

#include "core/source/bytes/file_content.h"

#include <cstdint>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/source/bytes/file_start.h"
#include "core/source/bytes/zip_file.h"

namespace isoscope::source {
namespace {

constexpr char kUnpack[] = "unpack it, and give what is in it";
constexpr char kLfsPointer[] = "a Git LFS pointer, not the file itself";
constexpr char kLfsAdvice[] = "fetch it with git lfs pull";
// Git LFS, docs/spec.md: pointers are smaller than this.
constexpr std::int64_t kMaxLfsPointerBytes = 1024;
constexpr char kVideo[] = "save its frames as slices, as PNG or TIFF";

// Keeps the zeros in a literal.
template <std::size_t N>
constexpr absl::string_view Bytes(const char (&text)[N]) {
  return {text, N - 1};
}

// A mark that the first bytes have at some place.
struct Mark {
  absl::string_view bytes;
  const char* name;
  const char* advice;
  std::size_t offset = 0;
};

const std::vector<Mark>& Marks() {
  static const auto* const marks = new std::vector<Mark>{
      {kLfsPointerMark, kLfsPointer, kLfsAdvice},
      {"/annex/objects/", "a pointer of git-annex, not the file itself",
       "fetch it with git annex get"},
      {Bytes("\x0e\x03\x13\x01"), "HDF4",
       "convert it to HDF5 (h4toh5 of the HDF Group) or to netCDF"},
      {"MATLAB 5.0 MAT-file", "a MAT-file of version 5 to 7",
       "save it with MATLAB's -v7.3, which is HDF5"},
      {"# AmiraMesh", "Amira's own format", kAmiraAdvice},
      {"# HyperMesh", "Amira's own format", kAmiraAdvice},
      {"# Avizo", "Amira's own format", kAmiraAdvice},
      {"object 1 class gridpositions", "OpenDX", kOpenDxAdvice},
      {"\xc3\x40\xf1", "SEG-Y", kSegyAdvice},  // "C 1" in EBCDIC
      {"GRIB", "GRIB", "convert it to netCDF, as cdo -f nc copy IN OUT does"},
      {"LASF", "a cloud of points (LAS)", "grid it first"},
      {"solid ", "STL", kMeshAdvice},
      {"ply\n", "PLY", kMeshAdvice},
      {"ply\r\n", "PLY", kMeshAdvice},
      {"OFF\n", "OFF", kMeshAdvice},
      {"glTF", "glTF", kMeshAdvice},
      {"#VRML", "VRML", kMeshAdvice},
      {Bytes("PK\x03\x04"), "a ZIP archive", kUnpack},
      {"ustar", "a tar archive", kUnpack, 257},
      {Bytes("7z\xbc\xaf\x27\x1c"), "a 7z archive", kUnpack},
      {"Rar!", "a RAR archive", kUnpack},
      {Bytes("\xfd"
             "7zXZ\0"),
       "a file that xz compressed", "decompress it (unxz)"},
      {Bytes("\x28\xb5\x2f\xfd"), "a file that Zstandard compressed", "decompress it (unzstd)"},
      {Bytes("\x04\x22\x4d\x18"), "a file that LZ4 compressed", "decompress it (unlz4)"},
      {"BZh", "a file that bzip2 compressed", "decompress it (bunzip2)"},
      {Bytes("\x1f\x9d"), "a file that compress compressed", "decompress it (uncompress)"},
      {Bytes("\x89PNG"), "a PNG picture", kStackAdvice},
      {Bytes("\xff\xd8\xff"), "a JPEG picture", kStackAdvice},
      {"GIF8", "a GIF picture", "save its frames as PNG slices"},
      {"WEBP", "a WebP picture", "save it as PNG; a volume is a stack of them", 8},
      {"AVI ", "a video", kVideo, 8},
      {"ftyp", "a video", kVideo, 4},
      {Bytes("\x1a\x45\xdf\xa3"), "a video", kVideo},
      {"%PDF", "a PDF document", "give the data themselves"},
      {"%!PS", "a PostScript document", "give the data themselves"},
      {Bytes("\x7f"
             "ELF"),
       "a program", "give a volume"},
      {"SQLite format 3", "an SQLite database", kServeAdvice},
  };
  return *marks;
}

// Describes an XML file; nullopt if its reader takes it.
std::optional<std::string> DescribeXml(absl::string_view head) {
  const std::size_t vtk = head.find("<VTKFile");
  if (vtk != head.npos) {
    const absl::string_view tag = head.substr(vtk, head.find('>', vtk) - vtk);
    for (const char* read :
         {"\"ImageData\"", "\"PImageData\"", "\"RectilinearGrid\"", "\"Collection\""}) {
      if (absl::StrContains(tag, read)) {
        return std::nullopt;
      }
    }
    return RefusedSentence("a VTK grid that is not regular, or a mesh", kResampleAdvice);
  }
  if (absl::StrContains(head, "<Xdmf")) {
    return RefusedSentence("XDMF", kXdmfAdvice);
  }
  if (absl::StrContains(head, "<GIFTI")) {
    return RefusedSentence("a surface of the brain (GIFTI)", kMeshAdvice);
  }
  if (absl::StrContains(head, "<Error>") || absl::StrContains(head, "<Error ")) {
    return "an error message of a server (XML), not the file itself: the download went wrong";
  }
  if (absl::StrContains(head, "<OME") || absl::StrContains(head, "<NIFTI")) {
    return std::nullopt;
  }
  return "XML, which is not read: give the file with the samples";
}

bool IsWebPage(absl::string_view head) {
  absl::string_view text = absl::StripLeadingAsciiWhitespace(head);
  return absl::StartsWithIgnoreCase(text, "<!doctype html") ||
         absl::StartsWithIgnoreCase(text, "<html");
}

// Describes plain content, not a gzip stream.
std::optional<std::string> DescribeHead(absl::string_view head) {
  constexpr absl::string_view kByteOrderMark = "\xef\xbb\xbf";
  if (absl::StartsWith(head, kByteOrderMark)) {
    head.remove_prefix(kByteOrderMark.size());
  }
  if (IsWebPage(head)) {
    return "a web page (HTML), not the file itself: the download went wrong";
  }
  const absl::string_view text = absl::StripLeadingAsciiWhitespace(head);
  if (absl::StartsWith(text, "<?xml") || absl::StartsWith(text, "<VTKFile") ||
      absl::StartsWith(text, "<Xdmf") || absl::StartsWith(text, "<Error")) {
    return DescribeXml(text);
  }
  if (absl::EndsWith(FirstZipName(head), ".npy")) {
    return std::nullopt;  // arrays of NumPy
  }
  for (const Mark& mark : Marks()) {
    if (head.size() >= mark.offset && absl::StartsWith(head.substr(mark.offset), mark.bytes)) {
      return RefusedSentence(mark.name, mark.advice);
    }
  }
  return std::nullopt;
}

// A format that is read if no gzip stream is around it; "" for others.
std::string NameOfPlainFormat(absl::string_view head) {
  struct Plain {
    absl::string_view mark;
    const char* name;
  };
  static constexpr Plain kPlain[] = {
      {"NRRD000", "NRRD"},      {"ObjectType", "MetaImage"},          {"NDims", "MetaImage"},
      {"CDF", "netCDF"},        {Bytes("\x89HDF\r\n\x1a\n"), "HDF5"}, {Bytes("II*\0"), "TIFF"},
      {Bytes("MM\0*"), "TIFF"}, {"# vtk DataFile", "legacy VTK"},     {"<VTKFile", "a file of VTK"},
      {"<?xml", "XML"}};
  for (const Plain& plain : kPlain) {
    if (absl::StartsWith(head, plain.mark)) {
      return plain.name;
    }
  }
  return head.size() >= 132 && head.substr(128, 4) == "DICM" ? "DICOM" : "";
}

std::optional<std::string> DescribeStart(const FileStart& start) {
  if (!start.is_gzip) {
    return start.bytes.empty()
               ? std::optional<std::string>("an empty file: copy or download it again")
               : DescribeHead(start.bytes);
  }
  if (const auto inner = DescribeHead(start.bytes); inner.has_value()) {
    return absl::StrCat("a gzip stream of ", *inner);
  }
  const std::string name = NameOfPlainFormat(start.bytes);
  return name.empty() ? std::nullopt
                      : std::optional<std::string>(absl::StrCat(
                            name, " in a gzip stream, which is not read: decompress it (gunzip)"));
}

}  // namespace

std::string RefusedSentence(absl::string_view name, absl::string_view advice) {
  return absl::StrCat(name, ", which is not read: ", advice);
}

std::optional<std::string> DescribeContent(const std::string& path) {
  const auto start = ReadFileStart(path, kContentBytes);
  return start.ok() ? DescribeStart(*start) : std::nullopt;
}

absl::Status LfsPointerError(absl::string_view name) {
  return absl::InvalidArgumentError(
      absl::StrCat(name, ": ", RefusedSentence(kLfsPointer, kLfsAdvice)));
}

absl::Status CheckIsNoLfsPointer(const io::RandomAccessFile& file) {
  std::string start(absl::string_view(kLfsPointerMark).size(), '\0');
  const bool may_be_one = file.size_bytes() < kMaxLfsPointerBytes &&
                          file.size_bytes() > static_cast<std::int64_t>(start.size());
  return may_be_one && file.ReadAt(0, start.size(), start.data()).ok() && start == kLfsPointerMark
             ? LfsPointerError(file.path())
             : absl::OkStatus();
}

}  // namespace isoscope::source
