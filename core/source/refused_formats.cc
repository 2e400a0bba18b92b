// A file is described in three steps, the first that knows it counts:
//
//   1. by its first bytes: a mark at some place, or a text that they begin with
//   2. by its name; a folder by a file in it
//   3. as text or binary, with how it begins
//
// A gzip stream is described by what is in it.

#include "core/source/refused_formats.h"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"

#include "core/base/printable.h"
#include "core/io/file.h"
#include "core/source/file_start.h"
#include "core/source/hdf5_path.h"
#include "core/source/image_slices.h"
#include "core/source/named_files.h"
#include "core/source/part_path.h"
#include "core/source/sample_location.h"
#include "core/source/series_format.h"
#include "core/source/vtk_image.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kHeadBytes = 1024;

constexpr char kUnpack[] = "unpack it, and give what is in it";
constexpr char kStack[] =
    "slices are a folder of such files or a pattern, with names that say their format";
constexpr char kMesh[] =
    "a mesh, not a volume: isoscope makes meshes (isoscope export) and reads what they are made of";
constexpr char kResample[] =
    "resample it, as ParaView's filter \"Resample To Image\" does, and save it as .vti";
constexpr char kImage[] = "save it as NRRD, MetaImage or .vti";
constexpr char kServe[] = "in Python, isoscope.serve(array) takes its array";
constexpr char kVideo[] = "save its frames as slices, as PNG or TIFF";
constexpr char kOmeTiff[] = "convert it to OME-TIFF, as bfconvert of Bio-Formats does";

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
      {"version https://git-lfs.github.com/spec/", "a Git LFS pointer, not the file itself",
       "fetch it with git lfs pull"},
      {"/annex/objects/", "a pointer of git-annex, not the file itself",
       "fetch it with git annex get"},
      {Bytes("\x0e\x03\x13\x01"), "HDF4",
       "convert it to HDF5 (h4toh5 of the HDF Group) or to netCDF"},
      {Bytes("\x93NUMPY"), "a NumPy array", "in Python, isoscope.serve(numpy.load(FILE)) takes it"},
      {"MATLAB 5.0 MAT-file", "a MAT-file of version 5 to 7",
       "save it with MATLAB's -v7.3, which is HDF5"},
      {"SIMPLE  =", "FITS", kServe},
      {"# AmiraMesh", "Amira's own format", kImage},
      {"# Avizo", "Amira's own format", kImage},
      {"GRIB", "GRIB", "convert it to netCDF, as cdo -f nc copy IN OUT does"},
      {"LASF", "a cloud of points (LAS)", "grid it first"},
      {"solid ", "STL", kMesh},
      {"ply\n", "PLY", kMesh},
      {"ply\r\n", "PLY", kMesh},
      {"OFF\n", "OFF", kMesh},
      {"glTF", "glTF", kMesh},
      {"#VRML", "VRML", kMesh},
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
      {Bytes("\x89PNG"), "a PNG picture", kStack},
      {Bytes("\xff\xd8\xff"), "a JPEG picture", kStack},
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
      {"SQLite format 3", "an SQLite database", kServe},
  };
  return *marks;
}

struct RefusedFormat {
  const char* name;
  std::vector<std::string> endings;
  const char* advice;
  std::vector<std::string> in_folder{};  // a folder with such a file is of this format
};

const std::vector<RefusedFormat>& RefusedFormats() {
  static const auto* const formats = new std::vector<RefusedFormat>{
      {.name = "N5",
       .endings = {".n5", "attributes.json"},
       .advice = "save the dataset as HDF5 or as TIFF slices, as Fiji does",
       .in_folder = {"attributes.json"}},
      {.name = "Zarr",
       .endings = {".zarr", ".zarray", ".zgroup", "zarr.json"},
       .advice = "save the array as HDF5 or as TIFF slices, as Fiji and h5py do",
       .in_folder = {".zarray", ".zgroup", "zarr.json"}},
      {.name = "OpenFOAM",
       .endings = {".foam"},
       .advice = kResample,
       .in_folder = {"system/controlDict"}},
      {.name = "a VTK grid that is not regular, or a mesh",
       .endings = {".vtu", ".vts", ".vtp", ".vtm", ".vtmb", ".vth", ".pvtu", ".pvts", ".pvtp",
                   ".pvtr"},
       .advice = kResample},
      {.name = "a mesh of Exodus",
       .endings = {".exo", ".ex2", ".exii", ".e", ".g"},
       .advice = kResample},
      {.name = "EnSight", .endings = {".case", ".encas"}, .advice = kResample},
      {.name = "XDMF",
       .endings = {".xdmf", ".xmf", ".xdmf2", ".xdmf3"},
       .advice = "give the HDF5 file that it names, with the dataset: FILE.h5:/name"},
      {.name = "a mesh of finite elements",
       .endings = {".msh", ".inp", ".unv", ".bdf", ".nas", ".med"},
       .advice = kResample},
      {.name = "a mesh",
       .endings = {".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".fbx", ".dae", ".3mf", ".wrl",
                   ".x3d"},
       .advice = kMesh},
      {.name = "a surface of the brain", .endings = {".gii"}, .advice = kMesh},
      {.name = "streamlines",
       .endings = {".trk", ".tck", ".trx"},
       .advice = "give the volume that they were made of"},
      {.name = "a cloud of points", .endings = {".las", ".laz", ".pcd"}, .advice = "grid it first"},
      {.name = "a microscope's own format",
       .endings = {".czi", ".lif", ".nd2", ".oib", ".oif", ".oir", ".vsi", ".zvi", ".lei"},
       .advice = kOmeTiff},
      {.name = "a slide",
       .endings = {".svs", ".ndpi", ".mrxs", ".scn"},
       .advice = "it is one plane, of which no volume can be made"},
      {.name = "Gatan's own format",
       .endings = {".dm3", ".dm4"},
       .advice = "save it as MRC or TIFF, as dm2mrc and Fiji do"},
      {.name = "SEG-Y", .endings = {".sgy", ".segy"}, .advice = kServe},
      {.name = "a Python pickle",
       .endings = {".pkl", ".pickle", ".pt", ".pth"},
       .advice = "which runs code of its author when it is read; in Python, isoscope.serve(array)"},
      {.name = "NumPy arrays in an archive",
       .endings = {".npz"},
       .advice = "in Python, isoscope.serve(numpy.load(FILE)[NAME]) takes one"},
      {.name = "a file of R", .endings = {".rds", ".rda", ".rdata"}, .advice = kServe},
      {.name = "an unfinished download",
       .endings = {".part", ".crdownload", ".download", ".aria2"},
       .advice = "let it finish, or download it again"},
      {.name = "a pointer of DVC",
       .endings = {".dvc"},
       .advice = "fetch the file with dvc pull, and give that"},
  };
  return *formats;
}

bool IsOf(const RefusedFormat& format, const std::string& path) {
  const auto in_folder = [&](const std::string& name) {
    return io::PathExists(absl::StrCat(path, "/", name));
  };
  return std::any_of(
             format.endings.begin(), format.endings.end(),
             [&](const std::string& ending) { return absl::EndsWithIgnoreCase(path, ending); }) ||
         std::any_of(format.in_folder.begin(), format.in_folder.end(), in_folder);
}

std::string Sentence(absl::string_view name, absl::string_view advice) {
  return absl::StrCat(name, ", which is not read: ", advice);
}

// What an XML file is; nullopt if its reader takes it.
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
    return Sentence("a VTK grid that is not regular, or a mesh", kResample);
  }
  if (absl::StrContains(head, "<Xdmf")) {
    return Sentence("XDMF", "give the HDF5 file that it names, with the dataset: FILE.h5:/name");
  }
  if (absl::StrContains(head, "<GIFTI")) {
    return Sentence("a surface of the brain (GIFTI)", kMesh);
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

// Of plain content, not of a gzip stream.
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
  for (const Mark& mark : Marks()) {
    if (head.size() >= mark.offset && absl::StartsWith(head.substr(mark.offset), mark.bytes)) {
      return Sentence(mark.name, mark.advice);
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

// How the bytes begin, for people: as text, or in hexadecimal.
std::string DescribeBytes(absl::string_view head) {
  const auto is_text = [](char c) {
    return !absl::ascii_iscntrl(static_cast<unsigned char>(c)) ||
           absl::ascii_isspace(static_cast<unsigned char>(c));
  };
  constexpr std::size_t kShown = 32;
  if (std::all_of(head.begin(), head.end(), is_text)) {
    const absl::string_view line = absl::StripLeadingAsciiWhitespace(head);
    return absl::StrCat("text that begins with \"",
                        base::PrintableAscii(line.substr(0, std::min(line.find('\n'), kShown))),
                        "\"");
  }
  if (std::all_of(head.begin(), head.end(), [](char c) { return c == '\0'; })) {
    return "it begins with zeros";
  }
  return absl::StrCat("its first bytes are ", absl::BytesToHexString(head.substr(0, 8)));
}

std::string WithoutSlashes(const std::string& path) {
  std::string name = path;
  while (name.size() > 1 && name.back() == '/') {
    name.pop_back();
  }
  return name;
}

}  // namespace

std::optional<std::string> DescribeContent(const std::string& path) {
  const auto start = ReadFileStart(path, kHeadBytes);
  return start.ok() ? DescribeStart(*start) : std::nullopt;
}

std::optional<std::string> WhyRefused(const std::string& path) {
  const std::string name = WithoutSlashes(path);
  if (auto content = DescribeContent(name); content.has_value()) {
    return content;
  }
  for (const RefusedFormat& format : RefusedFormats()) {
    if (IsOf(format, name)) {
      return Sentence(format.name, format.advice);
    }
  }
  return std::nullopt;
}

std::string ListVolumesIn(const std::string& folder) {
  constexpr std::size_t kMaxListed = 3;
  const auto is_volume = [](const std::string& path) {
    Hdf5Path hdf5;
    PartPath vtk;
    return FindSeriesFileByName(path).has_value() || SplitHdf5Path(path, &hdf5) ||
           SplitVtkImagePath(path, &vtk) || absl::EndsWithIgnoreCase(path, ".pvd") ||
           SampleFormatOf(path).has_value();
  };
  std::vector<std::string> names;
  std::size_t count = 0;
  for (const std::string& file : FilesNamed(folder, is_volume)) {
    if (++count <= kMaxListed) {
      names.push_back(base::Printable(file.substr(file.rfind('/') + 1)));
    }
  }
  return absl::StrCat(absl::StrJoin(names, ", "),
                      count > kMaxListed ? absl::StrCat(" and ", count - kMaxListed, " more") : "");
}

absl::Status UnknownKindOfFile(const std::string& path) {
  if (const auto why = WhyRefused(path); why.has_value()) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", *why));
  }
  const auto start = ReadFileStart(path, kHeadBytes);
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": unknown kind of file",
      start.ok()
          ? absl::StrCat(": ", start->is_gzip ? "a gzip stream; " : "", DescribeBytes(start->bytes))
          : "",
      "; `isoscope info --list-formats` lists those that are read; raw samples need --dims X,Y,Z "
      "--type T, and --header-bytes N if they do not begin the file"));
}

absl::Status ExplainByContent(const std::string& path, absl::Status status) {
  const bool can_be_explained =
      absl::IsInvalidArgument(status) || absl::IsDataLoss(status) || absl::IsNotFound(status);
  if (!can_be_explained) {
    return status;
  }
  // The file is the shortest of these names that exists: "a.vti:p:x", "a.vti:p", "a.vti".
  std::string file = path;
  for (std::size_t colon = path.find(':'); colon != std::string::npos && !io::PathExists(file);
       colon = path.find(':', colon + 1)) {
    file = path.substr(0, colon);
  }
  const auto content = DescribeContent(file);
  // A picture with the name of a slice is read: what is wrong is its stack.
  const bool is_slice =
      content.has_value() && IsImageSliceName(file) && absl::StrContains(*content, kStack);
  return content.has_value() && !is_slice && !absl::StrContains(status.message(), *content)
             ? absl::InvalidArgumentError(absl::StrCat(file, ": ", *content))
             : std::move(status);
}

}  // namespace isoscope::source
