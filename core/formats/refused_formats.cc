// A file is described in three steps, the first that knows it counts:
//
//   1. by its first bytes: a mark at some place, or a text that they begin with
//   2. by its name; a folder by a file in it
//   3. as text or binary, with how it begins
//
// A gzip stream is described by what is in it.

#include "core/formats/refused_formats.h"

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
#include "core/formats/find_volume.h"
#include "core/io/file.h"
#include "core/source/bytes/file_content.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/named_files.h"

namespace isoscope::source {
namespace {

constexpr char kArchive[] = "a ZIP archive";
constexpr char kOmeTiff[] = "convert it to OME-TIFF, as bfconvert of Bio-Formats does";

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
      {.name = "OpenFOAM",
       .endings = {".foam"},
       .advice = kResampleAdvice,
       .in_folder = {"system/controlDict"}},
      {.name = "a VTK grid that is not regular, or a mesh",
       .endings = {".vtu", ".vts", ".vtp", ".vtm", ".vtmb", ".vth", ".pvtu", ".pvts", ".pvtp",
                   ".pvtr"},
       .advice = kResampleAdvice},
      {.name = "a mesh of Exodus",
       .endings = {".exo", ".ex2", ".exii", ".e", ".g"},
       .advice = kResampleAdvice},
      {.name = "EnSight", .endings = {".case", ".encas"}, .advice = kResampleAdvice},
      {.name = "XDMF", .endings = {".xdmf", ".xmf", ".xdmf2", ".xdmf3"}, .advice = kXdmfAdvice},
      {.name = "a mesh of finite elements",
       .endings = {".msh", ".inp", ".unv", ".bdf", ".nas", ".med"},
       .advice = kResampleAdvice},
      {.name = "a mesh",
       .endings = {".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".fbx", ".dae", ".3mf", ".wrl",
                   ".x3d"},
       .advice = kMeshAdvice},
      {.name = "a surface of the brain", .endings = {".gii"}, .advice = kMeshAdvice},
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
      {.name = "Gatan's own format", .endings = {".dm3", ".dm4"}, .advice = kGatanAdvice},
      {.name = "BMP", .endings = {".bmp"}, .advice = "save the slices as PNG or TIFF"},
      {.name = "a format of few tools (BioRad, GIPL, SLC, Stimulate)",
       .endings = {".pic", ".gipl", ".gipl.gz", ".slc", ".spr"},
       .advice = kServeAdvice},
      {.name = "SEG-Y", .endings = {".sgy", ".segy"}, .advice = kSegyAdvice},
      {.name = "Amira's own format", .endings = {".am", ".amiramesh"}, .advice = kAmiraAdvice},
      {.name = "OpenDX", .endings = {".dx"}, .advice = kOpenDxAdvice},
      {.name = "a Python pickle",
       .endings = {".pkl", ".pickle", ".pt", ".pth"},
       .advice = "which runs code of its author when it is read; in Python, isoscope.serve(array)"},
      {.name = "a file of R", .endings = {".rds", ".rda", ".rdata"}, .advice = kServeAdvice},
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

// Describes the first bytes for people: as text, or in hexadecimal.
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

std::optional<std::string> WhyRefused(const std::string& path) {
  const std::string name = WithoutSlashes(path);
  if (auto content = DescribeContent(name); content.has_value()) {
    return content;
  }
  for (const RefusedFormat& format : RefusedFormats()) {
    if (IsOf(format, name)) {
      return RefusedSentence(format.name, format.advice);
    }
  }
  return std::nullopt;
}

std::string ListVolumesIn(const std::string& folder, absl::Span<const Format> formats) {
  constexpr std::size_t kMaxListed = 3;
  std::vector<std::string> names;
  std::size_t count = 0;
  for (const std::string& file : FilesNamed(folder, [](const std::string&) { return true; })) {
    auto found = FindByName(file, formats);
    if (found.ok() && !found->has_value()) {
      found = FindByContent(file, formats);
    }
    // A file of a DICOM series is no volume in its folder's place.
    const bool is_volume =
        !found.ok() || (found->has_value() && (*found)->format->list_series == nullptr);
    if (is_volume && ++count <= kMaxListed) {
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
  const auto start = ReadFileStart(path, kContentBytes);
  return absl::InvalidArgumentError(absl::StrCat(
      path, ": unknown kind of file",
      start.ok()
          ? absl::StrCat(": ", start->is_gzip ? "a gzip stream; " : "", DescribeBytes(start->bytes))
          : "",
      "; `isoscope info --list-formats` lists those that are read; raw samples need --dims X,Y,Z "
      "--type T, and --header-bytes N if they do not begin the file"));
}

absl::Status ExplainByContent(const std::string& path, absl::Status status,
                              absl::Span<const Format> formats) {
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
  if (content.has_value() && absl::StrContains(*content, kArchive)) {
    const auto found = FindVolume(file, "", formats);
    if (found.ok() && found->format->opens_archives) {
      return status;
    }
  }
  if (content.has_value() && absl::StrContains(*content, kStackAdvice)) {
    // A picture with the name of a slice is read: what is wrong is its stack.
    const auto found = FindByName(file, formats);
    if (found.ok() && found->has_value() && (*found)->format->shows_pictures) {
      return status;
    }
  }
  return content.has_value() && !absl::StrContains(status.message(), *content)
             ? absl::InvalidArgumentError(absl::StrCat(file, ": ", *content))
             : std::move(status);
}

}  // namespace isoscope::source
