#include "client-cli/commands/help_layout.h"

#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"

#include "clients/cpp/request/look_flags.h"
#include "core/formats/format_table.h"
#include "core/view/camera_fit.h"
#include "core/volume/scalar_type.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {
namespace {

std::vector<std::string> ViewNames() {
  std::vector<std::string> names;
  for (const view::NamedViewRow& row : view::NamedViewTable()) {
    names.emplace_back(row.name);
  }
  return names;
}

std::vector<std::string> ScalarTypeNames() {
  std::vector<std::string> names;
  for (const volume::ScalarType type :
       {volume::ScalarType::kUint8, volume::ScalarType::kInt8, volume::ScalarType::kUint16,
        volume::ScalarType::kInt16, volume::ScalarType::kUint32, volume::ScalarType::kInt32,
        volume::ScalarType::kFloat32, volume::ScalarType::kFloat64}) {
    names.emplace_back(volume::NameOf(type));
  }
  return names;
}

std::vector<std::string> ForceableFormats() {
  std::vector<std::string> names;
  for (const source::FormatName& format : source::FormatNames()) {
    if (format.is_forceable) {
      names.push_back(format.name);
    }
  }
  return names;
}

// Those of the proto that flags take.
std::vector<std::string> ColorMaps() {
  std::vector<std::string> names;
  const google::protobuf::EnumDescriptor& maps = *isoscope::v1::ColorMap_descriptor();
  for (int i = 0; i < maps.value_count(); ++i) {
    const std::string name = absl::StrReplaceAll(
        absl::AsciiStrToLower(absl::StripPrefix(maps.value(i)->name(), "COLOR_MAP_")),
        {{"_", "-"}});
    if (client::ParseCaps(name).ok()) {
      names.push_back(name);
    }
  }
  return names;
}

std::vector<std::string> ColorsByMap() {
  std::vector<std::string> words;
  for (const char* quantity : {"x", "y", "z", "gradient"}) {
    for (const std::string& map : ColorMaps()) {
      words.push_back(absl::StrCat(quantity, ":", map));
    }
  }
  return words;
}

}  // namespace

HelpLayout HelpLayoutOfCommands() {
  HelpLayout layout;
  layout.headings = {
      {"Input", {"--server", "--dataset", "--dataset-id", "--like"}},
      {"Output",
       {"--output", "--append", "--resume", "--format", "--width", "--height", "--region",
        "--background", "--quality", "--show", "--json", "--once", "--interval", "--max-lines",
        "--list-formats", "--no-metadata"}},
      {"Samples", {"--dims", "--type", "--seed", "--spacing", "--origin"}},
      {"Fields", {}},
      {"Pixels", {"--pixel", "--all-fields"}},
      {"Surfaces",
       {"--isovalue", "--surface", "--color", "--label", "--labels", "--smooth-labels",
        "--max-layers"}},
      {"Levels", {}},
      {"Meshes", {"--close", "--min-component", "--simplify", "--simplify-error"}},
      {"Values", {"--values", "--histogram", "--bins", "--range", "--log"}},
      {"Field and time", {}},
      {"Fields and time steps", {}},
      {"Views", {}},
      {"Camera (default: the first look, as of the page)", {}},
      {"Lights and colours", {}},
      {"Cuts", {"--clip-plane", "--clip-box", "--caps", "--cap-window"}},
      {"Effects", {}},
      {"Annotations (drawn over the picture)", {}},
      {"Films", {"--repeat", "--orbit", "--fps"}},
      {"Arrays and statistics",
       {"--stats", "--no-measures", "--depth", "--surface-index", "--position", "--normal",
        "--depth-bounds", "--trace"}},
      {"Addresses and tokens",
       {"--listen", "--published", "--allow-origin", "--tokens", "--gateway-token-file",
        "--no-open", "--terminal"}},
      {"Parts of a source", {}},
      {"Raw files", {}},
      {"World positions, in place of the file's", {}},
      {"Blocks and shards",
       {"--shards", "--block-cells", "--distribution", "--compact", "--index-only", "--compression",
        "--levels", "--label-levels", "--add-levels", "--drop-levels", "--part", "--finish"}},
      {"Time and memory",
       {"--renderer", "--culling", "--allow-partial", "--threads", "--memory-limit",
        "--cache-limit", "--timeout"}},
      {"Connections",
       {"--tls-ca", "--tls-cert", "--tls-key", "--tls-server-name", "--token-file", "--insecure"}},
      {"General", {"--quiet", "--verbose", "--help", "--help-all"}},
  };
  layout.common = {
      {"partition", {"INPUT",     "--output",       "--append", "--field",      "--step",
                     "--crop",    "--stride",       "--dims",   "--type",       "--shards",
                     "--compact", "--index-only",   "--levels", "--add-levels", "--part",
                     "--finish",  "--memory-limit", "--quiet",  "--help",       "--help-all"}},
      {"info",
       {"INPUT|DIR", "--server", "--dataset", "--json", "--list-formats", "--isovalue", "--label",
        "--values", "--histogram", "--range", "--log", "--field", "--step", "--help",
        "--help-all"}},
      {"serve",
       {"INPUT|DIR", "--listen", "--tokens", "--shards", "--renderer", "--threads",
        "--memory-limit", "--tls-ca", "--tls-cert", "--tls-key", "--help", "--help-all"}},
      {"render",
       {"INPUT|DIR",    "--server",  "--output",  "--width",     "--height",      "--background",
        "--isovalue",   "--surface", "--color",   "--label",     "--max-spacing", "--field",
        "--step",       "--view",    "--azimuth", "--elevation", "--zoom",        "--color-by",
        "--clip-plane", "--caps",    "--samples", "--legend",    "--help",        "--help-all"}},
      {"pick",
       {"INPUT|DIR", "--server", "--json", "--width", "--height", "--pixel", "--all-fields",
        "--isovalue", "--surface", "--label", "--field", "--step", "--view", "--azimuth",
        "--elevation", "--zoom", "--clip-plane", "--help", "--help-all"}},
      {"export",
       {"INPUT|DIR", "--server", "--output", "--format", "--isovalue", "--surface", "--color",
        "--label", "--labels", "--close", "--min-component", "--simplify", "--field", "--step",
        "--clip-plane", "--stats", "--quiet", "--help", "--help-all"}},
      {"view",
       {"INPUT|DIR", "--server", "--dataset", "--isovalue", "--label", "--labels", "--listen",
        "--no-open", "--terminal", "--show", "--renderer", "--memory-limit", "--help",
        "--help-all"}},
  };
  return layout;
}

std::vector<ValueWords> WordsOfCommands() {
  return {{"--view", "NAME", ViewNames()},
          {"--type", "TYPE", ScalarTypeNames()},
          {"--format", "NAME", ForceableFormats()},
          {"--input-format", "NAME", ForceableFormats()},
          {"--caps", "", ColorMaps()},
          {"--color-by", "", ColorsByMap()}};
}

}  // namespace isoscope::cli
