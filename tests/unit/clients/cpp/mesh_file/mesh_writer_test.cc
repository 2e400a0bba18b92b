// Every format, read back by a parser of the test's own, as the specifications tell.

#include "clients/cpp/mesh_file/mesh_writer.h"

#include <array>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "core/base/coding.h"
#include "core/cli/usage.h"
#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/clients/cpp/mesh_file/test_meshes.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::TempDir;
using ::testing::HasSubstr;

constexpr frame::Color kOrange{.red = 1, .green = 0.5F, .blue = 0};

template <typename T>
T Load(const std::string& bytes, std::size_t offset) {
  return base::LoadLittleEndian<T>(bytes.data() + offset);
}

template <typename T>
std::vector<T> LoadArray(const std::string& bytes, std::size_t offset, std::size_t count) {
  std::vector<T> values(count);
  EXPECT_LE(offset + count * sizeof(T), bytes.size());
  if (count > 0) {
    std::memcpy(values.data(), bytes.data() + offset, count * sizeof(T));
  }
  return values;
}

struct ReadMesh {
  std::vector<float> positions;
  std::vector<double> world;  // positions of a mesh with an origin
  std::vector<float> normals;
  std::vector<std::uint32_t> triangles;
  std::vector<double> color;  // of the first vertex, or of all materials
  std::vector<int> surfaces;  // where the format tells: of each corner of each triangle
};

// Facets have no common vertices: equal corners become one.
ReadMesh ReadStl(const std::string& bytes) {
  EXPECT_FALSE(absl::StartsWith(bytes, "solid"));
  ReadMesh mesh;
  const auto count = Load<std::uint32_t>(bytes, 80);
  EXPECT_EQ(bytes.size(), 84 + 50 * std::size_t{count});
  std::map<std::array<float, 3>, std::uint32_t> vertices;
  for (std::size_t i = 0; i < count; ++i) {
    const std::vector<float> values = LoadArray<float>(bytes, 84 + 50 * i, 12);
    math::Vec3d p[4];
    for (std::size_t k = 0; k < 4; ++k) {
      p[k] = {double{values[3 * k]}, double{values[3 * k + 1]}, double{values[3 * k + 2]}};
    }
    EXPECT_NEAR(math::Length(p[0] - math::Normalized(math::Cross(p[2] - p[1], p[3] - p[1]))), 0,
                1e-6)
        << "normal of facet " << i;
    for (std::size_t k = 1; k < 4; ++k) {
      const std::array<float, 3> corner{values[3 * k], values[3 * k + 1], values[3 * k + 2]};
      const auto [found, is_new] =
          vertices.try_emplace(corner, static_cast<std::uint32_t>(vertices.size()));
      if (is_new) {
        mesh.positions.insert(mesh.positions.end(), corner.begin(), corner.end());
      }
      mesh.triangles.push_back(found->second);
    }
  }
  return mesh;
}

ReadMesh ReadObj(const std::string& text) {
  ReadMesh mesh;
  int object = -1;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream in(line);
    std::string word;
    in >> word;
    if (word == "v" || word == "vn") {
      std::vector<float>& to = word == "v" ? mesh.positions : mesh.normals;
      for (int k = 0; k < 3; ++k) {
        std::string number;
        in >> number;
        to.push_back(std::stof(number));
      }
      mesh.color.clear();
      for (double channel = 0; in >> channel;) {
        mesh.color.push_back(channel);
      }
    } else if (word == "f") {
      for (int k = 0; k < 3; ++k) {
        std::string corner;
        in >> corner;
        const std::size_t slashes = corner.find("//");
        EXPECT_EQ(corner.substr(0, slashes), corner.substr(slashes + 2));
        const unsigned long vertex = std::stoul(corner) - 1;
        EXPECT_LT(vertex, mesh.positions.size() / 3) << "used before it is there";
        mesh.triangles.push_back(static_cast<std::uint32_t>(vertex));
      }
      mesh.surfaces.insert(mesh.surfaces.end(), 3, object);
    } else if (word == "o") {
      EXPECT_TRUE(absl::StrContains(line, "_isovalue_")) << line;
      object = line[absl::string_view("o surface_").size()] - '0';
    } else {
      EXPECT_EQ(word, "#") << line;
    }
  }
  return mesh;
}

ReadMesh ReadGlb(const std::string& bytes) {
  ReadMesh mesh;
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  EXPECT_EQ(Load<std::uint32_t>(bytes, 4), 2U);
  EXPECT_EQ(Load<std::uint32_t>(bytes, 8), bytes.size());
  const auto json_bytes = Load<std::uint32_t>(bytes, 12);
  EXPECT_EQ(bytes.substr(16, 4), "JSON");
  EXPECT_EQ(json_bytes % 4, 0U);
  const nlohmann::json json = nlohmann::json::parse(bytes.substr(20, json_bytes));
  const std::size_t bin = 20 + json_bytes;
  EXPECT_EQ(Load<std::uint32_t>(bytes, bin), bytes.size() - bin - 8);
  EXPECT_EQ(bytes.substr(bin + 4, 4), std::string("BIN\0", 4));
  if (!json.contains("meshes")) {
    return mesh;
  }
  const auto read = [&]<typename T>(const nlohmann::json& index, int components, T) {
    const nlohmann::json& accessor = json.at("accessors").at(index.get<std::size_t>());
    const nlohmann::json& view =
        json.at("bufferViews").at(accessor.at("bufferView").get<std::size_t>());
    const std::size_t count =
        accessor.at("count").get<std::size_t>() * static_cast<std::size_t>(components);
    const std::size_t offset = accessor.value("byteOffset", std::size_t{0});
    EXPECT_LE(offset + count * sizeof(T), view.at("byteLength").get<std::size_t>());
    EXPECT_EQ(view.value("byteStride", 12), 12);
    const int type = std::is_same_v<T, float> ? 5126 : 5125;
    EXPECT_EQ(accessor.at("componentType"), type);
    return LoadArray<T>(bytes, bin + 8 + view.at("byteOffset").get<std::size_t>() + offset, count);
  };
  for (const nlohmann::json& primitive : json.at("meshes").at(0).at("primitives")) {
    const auto first = static_cast<std::uint32_t>(mesh.positions.size() / 3);
    const nlohmann::json& attributes = primitive.at("attributes");
    const std::vector<float> positions = read(attributes.at("POSITION"), 3, float{});
    const nlohmann::json& accessor =
        json.at("accessors").at(attributes.at("POSITION").get<std::size_t>());
    for (std::size_t k = 0; k < 3; ++k) {
      float min = positions[k];
      float max = min;
      for (std::size_t i = k; i < positions.size(); i += 3) {
        min = std::min(min, positions[i]);
        max = std::max(max, positions[i]);
      }
      EXPECT_EQ(accessor.at("min").at(k).get<float>(), min);
      EXPECT_EQ(accessor.at("max").at(k).get<float>(), max);
    }
    mesh.positions.insert(mesh.positions.end(), positions.begin(), positions.end());
    const std::vector<float> normals = read(attributes.at("NORMAL"), 3, float{});
    mesh.normals.insert(mesh.normals.end(), normals.begin(), normals.end());
    for (const std::uint32_t index : read(primitive.at("indices"), 1, std::uint32_t{})) {
      EXPECT_LT(index, positions.size() / 3);
      mesh.triangles.push_back(first + index);
      mesh.surfaces.push_back(primitive.value("material", 0));
    }
  }
  for (const nlohmann::json& material : json.value("materials", nlohmann::json::array())) {
    for (const double factor : material.at("pbrMetallicRoughness").at("baseColorFactor")) {
      mesh.color.push_back(factor);
    }
  }
  return mesh;
}

// The value of an attribute in the text behind `from`.
std::size_t NumberAfter(const std::string& text, std::size_t from, const std::string& attribute) {
  const std::size_t at = text.find(attribute + "=\"", from);
  EXPECT_NE(at, std::string::npos) << attribute;
  return std::stoul(text.substr(at + attribute.size() + 2));
}

ReadMesh ReadVtp(const std::string& bytes) {
  ReadMesh mesh;
  const std::size_t mark = bytes.find('_', bytes.find("<AppendedData encoding=\"raw\">"));
  const std::string xml = bytes.substr(0, mark);
  const std::size_t vertex_count = NumberAfter(xml, 0, "NumberOfPoints");
  const std::size_t triangle_count = NumberAfter(xml, 0, "NumberOfPolys");
  const auto read = [&]<typename T>(const std::string& name, std::size_t count, T) {
    const std::size_t at = xml.find("Name=\"" + name + "\"");
    EXPECT_NE(at, std::string::npos) << name;
    const std::size_t begin = mark + 1 + NumberAfter(xml, at, "offset");
    EXPECT_EQ(Load<std::uint64_t>(bytes, begin), count * sizeof(T)) << name;
    return LoadArray<T>(bytes, begin + 8, count);
  };
  if (xml.find("type=\"Float64\" Name=\"Points\"") != std::string::npos) {
    mesh.world = read("Points", 3 * vertex_count, double{});
  } else {
    mesh.positions = read("Points", 3 * vertex_count, float{});
  }
  mesh.normals = read("Normals", 3 * vertex_count, float{});
  for (const std::int32_t vertex : read("connectivity", 3 * triangle_count, std::int32_t{})) {
    mesh.triangles.push_back(static_cast<std::uint32_t>(vertex));
  }
  const std::vector<std::int64_t> offsets = read("offsets", triangle_count, std::int64_t{});
  for (std::size_t i = 0; i < offsets.size(); ++i) {
    EXPECT_EQ(offsets[i], static_cast<std::int64_t>(3 * (i + 1)));
  }
  if (xml.find("Colors") != std::string::npos && vertex_count > 0) {
    for (const std::uint8_t channel : read("Colors", 3 * vertex_count, std::uint8_t{})) {
      mesh.color.push_back(channel);
    }
    mesh.color.resize(3);
  }
  if (xml.find("SurfaceIndex") != std::string::npos) {
    const auto indices = read("SurfaceIndex", vertex_count, std::uint8_t{});
    for (const std::uint32_t vertex : mesh.triangles) {
      mesh.surfaces.push_back(indices[vertex]);
    }
  }
  EXPECT_TRUE(absl::EndsWith(bytes, "\n  </AppendedData>\n</VTKFile>\n"));
  return mesh;
}

ReadMesh Read(MeshFormat format, const std::string& bytes) {
  return format == MeshFormat::kStl   ? ReadStl(bytes)
         : format == MeshFormat::kObj ? ReadObj(bytes)
         : format == MeshFormat::kGlb ? ReadGlb(bytes)
                                      : ReadVtp(bytes);
}

// Writes the sphere in pieces of 100 triangles, the vertices in two halves.
absl::StatusOr<std::string> Write(const MeshPiece& sphere, const MeshFileOptions& options) {
  absl::StatusOr<std::unique_ptr<MeshWriter>> writer = MeshWriter::Create(options);
  if (!writer.ok()) {
    return writer.status();
  }
  const auto half = static_cast<std::ptrdiff_t>(sphere.positions.size() / 6 * 3);
  MeshPiece first;
  first.positions.assign(sphere.positions.begin(), sphere.positions.begin() + half);
  first.normals.assign(sphere.normals.begin(), sphere.normals.begin() + half);
  MeshPiece second;
  second.positions.assign(sphere.positions.begin() + half, sphere.positions.end());
  second.normals.assign(sphere.normals.begin() + half, sphere.normals.end());
  ISOSCOPE_EXPECT_OK((*writer)->Add(first));
  for (std::size_t i = 0; i < sphere.triangles.size(); ++i) {
    second.triangles.push_back(sphere.triangles[i]);
    if (second.triangles.size() == 300 || i + 1 == sphere.triangles.size()) {
      ISOSCOPE_EXPECT_OK((*writer)->Add(second));
      second = {};
    }
  }
  const absl::Status finished = (*writer)->Finish();
  if (!finished.ok()) {
    return finished;
  }
  EXPECT_EQ((*writer)->size_bytes(),
            static_cast<std::int64_t>(std::filesystem::file_size(options.path)));
  return io::ReadWholeFile(options.path, 10'000'000);
}

constexpr MeshFormat kParsed[] = {MeshFormat::kStl, MeshFormat::kObj, MeshFormat::kGlb,
                                  MeshFormat::kVtp};

TEST(MeshWriterTest, EveryFormatReadsBackAsTheSameClosedSurface) {
  const TempDir folder;
  const MeshPiece sphere = MakeSphere(3, {10, -20, 30.5}, 7);
  for (const MeshFormat format : kParsed) {
    SCOPED_TRACE(NameOf(format));
    const std::string path = folder.Sub(absl::StrCat("mesh.", NameOf(format)));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes,
                                  Write(sphere, {.path = path, .format = format}));
    const ReadMesh mesh = Read(format, bytes);
    EXPECT_EQ(mesh.triangles.size(), 3U * 8 * 64);
    EXPECT_EQ(mesh.positions.size(), sphere.positions.size());
    EXPECT_TRUE(IsClosed(mesh.triangles));
    EXPECT_NEAR(VolumeOf(mesh.positions, mesh.triangles),
                VolumeOf(sphere.positions, sphere.triangles), 1e-9);
    EXPECT_GT(VolumeOf(mesh.positions, mesh.triangles), 0);
    EXPECT_TRUE(mesh.color.empty());
    if (format != MeshFormat::kStl) {
      EXPECT_EQ(mesh.positions, sphere.positions) << "bit for bit";
      EXPECT_EQ(mesh.normals, sphere.normals);
      EXPECT_EQ(mesh.triangles, sphere.triangles);
    }
  }
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()),
                          std::filesystem::directory_iterator()),
            4)
      << "scratch files are left";
}

// OBJ and VTP have sums of origin and offset, with all digits; STL and GLB say the origin.
TEST(MeshWriterTest, MeshesFarFromTheOriginKeepAllDigits) {
  const TempDir folder;
  MeshPiece sphere = MakeSphere(2, {0.5, 0.25, 0.125}, 0.0625);
  sphere.origin = math::Vec3d{500000, 4600000, -12.5};
  std::vector<double> world;
  for (std::size_t i = 0; i < sphere.positions.size(); ++i) {
    world.push_back((*sphere.origin)[static_cast<int>(i % 3)] + double{sphere.positions[i]});
  }
  const auto write = [&](MeshFormat format) {
    const MeshFileOptions options{.path = folder.Sub("mesh"), .format = format};
    const auto writer = MeshWriter::Create(options).value();
    ISOSCOPE_EXPECT_OK(writer->Add(sphere));
    ISOSCOPE_EXPECT_OK(writer->Finish());
    return io::ReadWholeFile(options.path, 10'000'000).value();
  };
  EXPECT_EQ(WorldPositionsOf(sphere), world);
  EXPECT_EQ(ReadVtp(write(MeshFormat::kVtp)).world, world);
  std::istringstream lines(write(MeshFormat::kObj));
  std::vector<double> obj_positions;
  for (std::string line; std::getline(lines, line);) {
    if (absl::StartsWith(line, "v ")) {
      std::istringstream in(line.substr(2));
      for (std::string number; in >> number;) {
        obj_positions.push_back(std::stod(number));
      }
    }
  }
  EXPECT_EQ(obj_positions, world);
  const std::string stl = write(MeshFormat::kStl);
  EXPECT_EQ(stl.substr(0, 80),
            "isoscope, binary STL, origin 500000 4600000 -12.5" + std::string(31, ' '));
  EXPECT_TRUE(IsClosed(ReadStl(stl).triangles));
  EXPECT_EQ(ReadStl(stl).positions.size(), sphere.positions.size());
  const std::string glb = write(MeshFormat::kGlb);
  EXPECT_EQ(ReadGlb(glb).positions, sphere.positions);
  const nlohmann::json json = nlohmann::json::parse(glb.substr(20, Load<std::uint32_t>(glb, 12)));
  EXPECT_EQ(json.at("nodes").at(0).at("translation"),
            nlohmann::json::array({500000.0, 4600000.0, -12.5}));
  for (const MeshFormat format : kParsed) {
    EXPECT_EQ(HasDoubles(format), format == MeshFormat::kObj || format == MeshFormat::kVtp);
  }
  EXPECT_TRUE(HasDoubles(MeshFormat::kPly));
}

// Indices of 257 surfaces do not fit into a byte.
TEST(MeshWriterTest, EveryFormatHoldsHundredsOfSurfaces) {
  const TempDir folder;
  for (const MeshFormat format : kParsed) {
    SCOPED_TRACE(NameOf(format));
    MeshFileOptions options{.path = folder.Sub("mesh"), .format = format};
    options.surfaces.resize(257, {.name = "left lung"});
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer, MeshWriter::Create(options));
    std::uint32_t first_vertex = 0;
    for (int i = 0; i < 257; ++i) {
      MeshPiece piece = MakeSphere(0, {3.0 * i, 0, 0}, 1, first_vertex);
      piece.surface_index = i;
      first_vertex += static_cast<std::uint32_t>(piece.vertex_count());
      ISOSCOPE_ASSERT_OK(writer->Add(piece));
    }
    ISOSCOPE_ASSERT_OK(writer->Finish());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes,
                                  io::ReadWholeFile(options.path, 10'000'000));
    if (format == MeshFormat::kVtp) {
      const std::size_t mark = bytes.find('_', bytes.find("<AppendedData encoding=\"raw\">"));
      const std::size_t at = bytes.find("type=\"Int32\" Name=\"SurfaceIndex\"");
      ASSERT_NE(at, std::string::npos);
      const std::size_t begin = mark + 1 + NumberAfter(bytes, at, "offset");
      EXPECT_EQ(Load<std::int32_t>(bytes, begin + 8 + 4 * (257 * 6 - 1)), 256);
    } else if (format == MeshFormat::kObj) {
      EXPECT_THAT(bytes, HasSubstr("o surface_256_left_lung\n"));
    } else {
      EXPECT_EQ(Read(format, bytes).triangles.size(), 257U * 24);
    }
  }
}

TEST(MeshWriterTest, ColorsAreThereWhereTheFormatHasThem) {
  const TempDir folder;
  const MeshPiece sphere = MakeSphere(1, {0, 0, 0}, 1);
  const auto color_of = [&](MeshFormat format) {
    const absl::StatusOr<std::string> bytes = Write(
        sphere, {.path = folder.Sub("mesh"), .format = format, .surfaces = {{.color = kOrange}}});
    EXPECT_THAT(bytes, testing::IsOk());
    return Read(format, *bytes).color;
  };
  EXPECT_THAT(color_of(MeshFormat::kVtp), ::testing::ElementsAre(255, 128, 0));
  const std::vector<double> linear = color_of(MeshFormat::kGlb);
  ASSERT_EQ(linear.size(), 4U);
  EXPECT_EQ(linear[0], 1);
  EXPECT_NEAR(linear[1], 0.2140411, 1e-6) << "sRGB 0.5 is linear 0.214";
  EXPECT_EQ(linear[2], 0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string obj,
                                Write(sphere, {.path = folder.Sub("m"),
                                               .format = MeshFormat::kObj,
                                               .surfaces = {{.color = kOrange}}}));
  EXPECT_THAT(obj, HasSubstr("v 1 0 0 1 0.5 0\n"));
  const absl::Status stl =
      Validate({.path = "a.stl", .format = MeshFormat::kStl, .surfaces = {{.color = kOrange}}});
  EXPECT_TRUE(absl::IsInvalidArgument(stl));
  EXPECT_THAT(std::string(stl.message()), HasSubstr("the colours of --surface and --label"));
}

// Three surfaces; the middle one has no triangle, and the first no colour of its own.
TEST(MeshWriterTest, SeveralSurfacesStayApartInOneFile) {
  const TempDir folder;
  const MeshPiece small = MakeSphere(1, {0, 0, 0}, 1);
  MeshPiece large = MakeSphere(2, {5, 5, 5}, 2, static_cast<std::uint32_t>(small.vertex_count()));
  large.surface_index = 2;
  for (const MeshFormat format : kParsed) {
    SCOPED_TRACE(NameOf(format));
    MeshFileOptions options{.path = folder.Sub("mesh"), .format = format};
    options.surfaces = {{.isovalue = 30}, {.isovalue = 99}, {.isovalue = -7.5, .color = kOrange}};
    if (format == MeshFormat::kStl) {
      options.surfaces[2].color.reset();
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer, MeshWriter::Create(options));
    ISOSCOPE_ASSERT_OK(writer->Add(small));
    ISOSCOPE_ASSERT_OK(writer->Add(large));
    ISOSCOPE_ASSERT_OK(writer->Finish());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes,
                                  io::ReadWholeFile(options.path, 1'000'000));
    const ReadMesh mesh = Read(format, bytes);
    EXPECT_EQ(mesh.triangles.size(), 3U * 8 * (4 + 16));
    EXPECT_TRUE(IsClosed(mesh.triangles));
    if (format == MeshFormat::kStl) {
      continue;
    }
    // In a GLB the test reads the index of the material: surfaces without triangles have none.
    std::vector<int> surfaces(small.triangles.size(), 0);
    surfaces.resize(mesh.triangles.size(), format == MeshFormat::kGlb ? 1 : 2);
    EXPECT_EQ(mesh.surfaces, surfaces);
    if (format == MeshFormat::kGlb) {
      ASSERT_EQ(mesh.color.size(), 8U);
      EXPECT_NEAR(mesh.color[0], 0.7304607, 1e-6) << "the clay of frames, 222 of 255";
      EXPECT_EQ(mesh.color[4], 1);
      EXPECT_THAT(bytes, HasSubstr("surface 2, isovalue -7.5"));
    } else if (format == MeshFormat::kObj) {
      EXPECT_THAT(bytes, HasSubstr("\no surface_2_isovalue_-7.5\n"));
      EXPECT_THAT(bytes, HasSubstr(" 1 0.5 0\nvn "));
    } else {
      EXPECT_THAT(mesh.color, ::testing::ElementsAre(222, 209, 190));
    }
  }
}

// Surfaces of the longest numbers, and of a name that is escaped: the room for the header is
// enough.
TEST(MeshWriterTest, HeadersHaveRoomForAllSurfaces) {
  const TempDir folder;
  for (const MeshFormat format : kParsed) {
    MeshFileOptions options{.path = folder.Sub("mesh"), .format = format};
    options.surfaces.resize(16, {.isovalue = -1.2345678901234567e-300});
    if (format != MeshFormat::kStl) {
      options.surfaces[0].color = frame::Color{.red = 0.123456F, .green = 0.0301F, .blue = 0.9F};
      options.surfaces.assign(16, options.surfaces[0]);
      options.surfaces[3].name = std::string(70000, '"');
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer, MeshWriter::Create(options));
    std::uint32_t first_vertex = 0;
    for (int i = 0; i < 16; ++i) {
      MeshPiece piece = MakeSphere(0, {-1.1e30, 3.3e-30, 0.1}, 1e-38, first_vertex);
      piece.surface_index = i;
      first_vertex += static_cast<std::uint32_t>(piece.vertex_count());
      ISOSCOPE_ASSERT_OK(writer->Add(piece));
    }
    ISOSCOPE_ASSERT_OK(writer->Finish());
  }
}

TEST(MeshWriterTest, FilesOfASeriesSayFieldAndStepAndOthersAreAsEver) {
  const TempDir folder;
  const MeshPiece sphere = MakeSphere(1, {0, 0, 0}, 1);
  const MeshField field{.name = "velocity",
                        .component = "x",
                        .unit = "m/s",
                        .step = 3,
                        .time = 0.25,
                        .time_unit = "s"};
  const auto write = [&](MeshFormat format, const std::optional<MeshField>& of) {
    return Write(sphere, {.path = folder.Sub("mesh"), .format = format, .field = of}).value();
  };
  for (const MeshFormat format : kParsed) {
    SCOPED_TRACE(NameOf(format));
    const std::string bytes = write(format, field);
    EXPECT_EQ(Read(format, bytes).triangles.size(), sphere.triangles.size());
    EXPECT_EQ(bytes.find("velocity") != std::string::npos, format != MeshFormat::kVtp);
    EXPECT_EQ(write(format, std::nullopt).find("velocity"), std::string::npos);
  }
  EXPECT_THAT(write(MeshFormat::kPly, field),
              HasSubstr("\ncomment field velocity:x\ncomment unit m/s\ncomment step 3\n"
                        "comment time 0.25 s\nelement vertex 18\n"));
  EXPECT_THAT(write(MeshFormat::kObj, field),
              ::testing::StartsWith("# isoscope\n# field velocity:x\n# unit m/s\n# step 3\n"
                                    "# time 0.25 s\nv "));
  EXPECT_EQ(write(MeshFormat::kStl, field).substr(0, 80),
            "isoscope, binary STL, field velocity:x, unit m/s, step 3, time 0.25 s           ");
  EXPECT_EQ(write(MeshFormat::kStl, MeshField{.name = std::string(200, 'a')}).size(),
            write(MeshFormat::kStl, std::nullopt).size());
  const std::string glb = write(MeshFormat::kGlb, field);
  const nlohmann::json extras =
      nlohmann::json::parse(glb.substr(20, Load<std::uint32_t>(glb, 12))).at("asset").at("extras");
  EXPECT_EQ(extras, nlohmann::json::parse(R"({"field": "velocity", "component": "x", "unit": "m/s",
                                              "step": 3, "time": 0.25, "time_unit": "s"})"));
  const std::string vtp = write(MeshFormat::kVtp, field);
  for (const char* const array :
       {"Name=\"Field\" NumberOfTuples=\"1\" format=\"ascii\">118 101 108 111 99 105 116 121 0<",
        "Name=\"FieldComponent\" NumberOfTuples=\"1\" format=\"ascii\">120 0<",
        "Name=\"FieldUnit\" NumberOfTuples=\"1\" format=\"ascii\">109 47 115 0<",
        "<DataArray type=\"Int32\" Name=\"TimeStep\" NumberOfTuples=\"1\" format=\"ascii\">3<",
        "<DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" "
        "format=\"ascii\">0.25<",
        "Name=\"TimeUnit\" NumberOfTuples=\"1\" format=\"ascii\">115 0<"}) {
    EXPECT_THAT(vtp, HasSubstr(array));
  }
}

TEST(MeshWriterTest, EmptySurfaceIsAValidFileOfEveryFormat) {
  const TempDir folder;
  for (const MeshFormat format : kParsed) {
    SCOPED_TRACE(NameOf(format));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto writer, MeshWriter::Create({.path = folder.Sub("mesh"), .format = format}));
    ISOSCOPE_ASSERT_OK(writer->Finish());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes,
                                  io::ReadWholeFile(folder.Sub("mesh"), 100'000));
    EXPECT_TRUE(Read(format, bytes).triangles.empty());
  }
}

TEST(MeshWriterTest, AbandonedWriterLeavesNothing) {
  const TempDir folder;
  for (const MeshFormat format :
       {MeshFormat::kPly, MeshFormat::kStl, MeshFormat::kObj, MeshFormat::kGlb, MeshFormat::kVtp}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto writer, MeshWriter::Create({.path = folder.Sub("mesh"), .format = format}));
    ISOSCOPE_ASSERT_OK(writer->Add(MakeSphere(0, {0, 0, 0}, 1)));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(MeshWriterTest, StlNormalOfATriangleWithoutAreaIsZero) {
  const TempDir folder;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto writer,
      MeshWriter::Create({.path = folder.Sub("a.stl"), .format = MeshFormat::kStl}));
  ISOSCOPE_ASSERT_OK(writer->Add({.positions = {1, 2, 3, 1, 2, 3, 4, 5, 6},
                                  .normals = std::vector<float>(9, 0),
                                  .triangles = {0, 1, 2}}));
  ISOSCOPE_ASSERT_OK(writer->Finish());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes,
                                io::ReadWholeFile(folder.Sub("a.stl"), 1000));
  EXPECT_EQ(LoadArray<float>(bytes, 84, 3), std::vector<float>(3, 0));
}

TEST(MeshWriterTest, SuffixAndFlagDecideTheFormatTogether) {
  EXPECT_EQ(MeshFormatOf("a.GLB", std::nullopt).value(), MeshFormat::kGlb);
  EXPECT_EQ(MeshFormatOf("a", std::nullopt).value(), MeshFormat::kPly);
  EXPECT_EQ(MeshFormatOf("a", MeshFormat::kVtp).value(), MeshFormat::kVtp);
  EXPECT_EQ(MeshFormatOf("a.mesh", MeshFormat::kVtp).value(), MeshFormat::kVtp);
  EXPECT_EQ(MeshFormatOf("a.stl", MeshFormat::kStl).value(), MeshFormat::kStl);
  EXPECT_TRUE(absl::IsInvalidArgument(MeshFormatOf("a.mesh", std::nullopt).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(MeshFormatOf("a.stl", MeshFormat::kPly).status()));
  EXPECT_THAT(std::string(ParseMeshFormat("fbx").status().message()), HasSubstr("ply, stl, obj"));
}

// A limit on the disk holds only if no format takes more than it told before its end.
TEST(MeshWriterTest, EachFormatTellsTheDiskThatItTakes) {
  constexpr std::int64_t kMaxHeaderBytes = 8192;
  for (const MeshFormat format : kMeshFormats) {
    for (const bool is_far : {false, true}) {
      const TempDir folder;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const std::unique_ptr<MeshWriter> writer,
          MeshWriter::Create({.path = folder.Sub("mesh"), .format = format}));
      MeshPiece piece = MakeSphere(4, {0, 0, 0}, 10);
      if (is_far) {
        piece.origin = math::Vec3d{1e7, 0, 0};
      }
      ISOSCOPE_ASSERT_OK(writer->Add(piece));
      const DiskUse use = writer->disk_use();
      EXPECT_GE(use.peak_bytes, use.file_bytes) << NameOf(format);
      ISOSCOPE_ASSERT_OK(writer->Finish());
      EXPECT_LE(use.file_bytes, writer->size_bytes()) << NameOf(format);
      EXPECT_GE(use.file_bytes + kMaxHeaderBytes, writer->size_bytes()) << NameOf(format);
    }
  }
}

}  // namespace
}  // namespace isoscope::client
