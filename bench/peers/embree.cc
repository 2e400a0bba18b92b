// A yardstick: the whole surface as a mesh, drawn by Intel's ray tracer. It gives the cost of
// primary rays on the same cores, without service, culling, disk and PNG.
//
//   apt-get install libembree-dev libtbb-dev
//   g++ -std=c++20 -O3 -march=native embree.cc -o embree -lembree3 -ltbb
//   isoscope export VOLUME --isovalue V --output surface.ply
//   ./embree surface.ply X,Y,Z [VIEWS]
//
// X,Y,Z are the samples on each axis, one world unit apart. The views are those of `isoscope render
// --azimuth 30 --elevation 20 --repeat VIEWS --orbit 7` at 1024 x 1024.
//
// 1. Reads the vertices (position, normal) and triangles of a PLY as `isoscope export` writes it.
// 2. Builds Embree's hierarchy: build_ms.
// 3. Traces one ray a pixel in coherent packets of 4 x 4 pixels, and shades hits by a head light:
//    first_ms, and next_ms, the median of the views after the first.
//
// Prints one line of JSON.

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <numbers>
#include <string>
#include <vector>

#include <embree3/rtcore.h>
#include <tbb/parallel_for.h>

namespace {

using Vec3 = std::array<float, 3>;

constexpr int kSide = 1024;        // pixels
constexpr int kPacketSide = 4;     // pixels; 16 rays
constexpr double kFovY = 30.0;     // degrees
constexpr float kAlbedo = 230.0F;  // of 255

struct Vertex {
  Vec3 position;
  Vec3 normal;
};

struct Mesh {
  std::vector<Vertex> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

[[noreturn]] void Fail(const std::string& reason) {
  std::cerr << "embree: " << reason << "\n";
  std::exit(1);  // NOLINT(concurrency-mt-unsafe): one thread
}

double MillisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

Mesh ReadPly(const char* path) {
  std::ifstream file(path, std::ios::binary);
  std::size_t vertex_count = 0;
  std::size_t triangle_count = 0;
  for (std::string line; std::getline(file, line) && line != "end_header";) {
    std::sscanf(line.c_str(), "element vertex %zu", &vertex_count);
    std::sscanf(line.c_str(), "element face %zu", &triangle_count);
  }
  Mesh mesh{.vertices = std::vector<Vertex>(vertex_count), .triangles = {}};
  file.read(reinterpret_cast<char*>(mesh.vertices.data()),
            static_cast<std::streamsize>(vertex_count * sizeof(Vertex)));
  constexpr std::size_t kFaceBytes = 1 + 3 * sizeof(std::uint32_t);
  std::vector<char> faces(triangle_count * kFaceBytes);
  file.read(faces.data(), static_cast<std::streamsize>(faces.size()));
  if (!file || triangle_count == 0) {
    Fail(std::string(path) + " is no PLY of triangles as isoscope writes it");
  }
  mesh.triangles.resize(triangle_count);
  for (std::size_t i = 0; i < triangle_count; ++i) {
    std::memcpy(mesh.triangles[i].data(), &faces[i * kFaceBytes + 1], kFaceBytes - 1);
  }
  return mesh;
}

RTCScene BuildScene(RTCDevice device, const Mesh& mesh) {
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* const positions = static_cast<Vec3*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vec3), mesh.vertices.size()));
  std::transform(mesh.vertices.begin(), mesh.vertices.end(), positions,
                 [](const Vertex& vertex) { return vertex.position; });
  void* const indices =
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                              3 * sizeof(std::uint32_t), mesh.triangles.size());
  std::memcpy(indices, mesh.triangles.data(), mesh.triangles.size() * 3 * sizeof(std::uint32_t));
  rtcCommitGeometry(geometry);
  RTCScene scene = rtcNewScene(device);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene);
  return scene;
}

// A camera that frames the sphere around the volume.
struct Camera {
  Camera(const std::array<double, 3>& dims, double azimuth, double elevation) {
    const double radians = std::numbers::pi / 180;
    const double a = azimuth * radians;
    const double e = elevation * radians;
    const double radius = std::hypot(dims[0] - 1, dims[1] - 1, dims[2] - 1) / 2;
    const double distance = radius / std::sin(kFovY / 2 * radians);
    half_height = static_cast<float>(std::tan(kFovY / 2 * radians));
    const std::array<double, 3> to_eye = {std::sin(a) * std::cos(e), std::sin(e),
                                          std::cos(a) * std::cos(e)};
    for (std::size_t k = 0; k < 3; ++k) {
      back[k] = static_cast<float>(to_eye[k]);
      eye[k] = static_cast<float>((dims[k] - 1) / 2 + distance * to_eye[k]);
    }
    right = {static_cast<float>(std::cos(a)), 0, static_cast<float>(-std::sin(a))};
    up = {back[1] * right[2], back[2] * right[0] - back[0] * right[2], -back[1] * right[0]};
  }

  float half_height;
  Vec3 eye;
  Vec3 back;  // from the target to the eye
  Vec3 right;
  Vec3 up;
};

// Draws one view into `picture` (kSide * kSide grey values), and returns the number of covered
// pixels.
std::size_t Draw(RTCScene scene, const Mesh& mesh, const Camera& camera,
                 std::vector<std::uint8_t>* picture) {
  constexpr int kPackets = kSide / kPacketSide;
  std::atomic<std::size_t> covered = 0;
  tbb::parallel_for(0, kPackets * kPackets, [&](int packet) {
    const int left = packet % kPackets * kPacketSide;
    const int top = packet / kPackets * kPacketSide;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    alignas(64) RTCRayHit16 rays;
    alignas(64) std::array<int, 16> valid;
    valid.fill(-1);
    for (int i = 0; i < 16; ++i) {
      const float x = 2 * (left + i % kPacketSide + 0.5F) / kSide - 1;
      const float y = 1 - 2 * (top + i / kPacketSide + 0.5F) / kSide;
      Vec3 direction;
      for (std::size_t k = 0; k < 3; ++k) {
        direction[k] =
            camera.half_height * (x * camera.right[k] + y * camera.up[k]) - camera.back[k];
      }
      rays.ray.org_x[i] = camera.eye[0];
      rays.ray.org_y[i] = camera.eye[1];
      rays.ray.org_z[i] = camera.eye[2];
      rays.ray.dir_x[i] = direction[0];
      rays.ray.dir_y[i] = direction[1];
      rays.ray.dir_z[i] = direction[2];
      rays.ray.tnear[i] = 0;
      rays.ray.tfar[i] = INFINITY;
      rays.ray.time[i] = 0;
      rays.ray.mask[i] = ~0U;
      rays.ray.flags[i] = 0;
      rays.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
      rays.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    rtcIntersect16(valid.data(), scene, &context, &rays);
    std::size_t hits = 0;
    for (int i = 0; i < 16; ++i) {
      float light = 0;
      if (rays.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID) {
        ++hits;
        const float u = rays.hit.u[i];
        const float v = rays.hit.v[i];
        const std::array<float, 3> weights = {1 - u - v, u, v};
        const auto& triangle = mesh.triangles[rays.hit.primID[i]];
        for (std::size_t corner = 0; corner < 3; ++corner) {
          const Vec3& normal = mesh.vertices[triangle[corner]].normal;
          for (std::size_t k = 0; k < 3; ++k) {
            light += weights[corner] * normal[k] * camera.back[k];
          }
        }
      }
      const int pixel = (top + i / kPacketSide) * kSide + left + i % kPacketSide;
      (*picture)[static_cast<std::size_t>(pixel)] =
          static_cast<std::uint8_t>(kAlbedo * std::min(1.0F, std::fabs(light)));
    }
    covered += hits;
  });
  return covered;
}

}  // namespace

int main(int argc, char** argv) {
  std::array<double, 3> dims;
  if (argc < 3 || std::sscanf(argv[2], "%lf,%lf,%lf", &dims[0], &dims[1], &dims[2]) != 3) {
    std::cerr << "usage: embree SURFACE.ply X,Y,Z [VIEWS]\n";
    return 2;
  }
  const int view_count = argc > 3 ? std::atoi(argv[3]) : 10;
  const Mesh mesh = ReadPly(argv[1]);
  const auto start = std::chrono::steady_clock::now();
  RTCDevice device = rtcNewDevice(nullptr);
  RTCScene scene = BuildScene(device, mesh);
  const double build = MillisecondsSince(start);

  std::vector<std::uint8_t> picture(std::size_t{kSide} * kSide);
  std::vector<double> times;
  std::size_t covered = 0;
  for (int view = 0; view < view_count; ++view) {
    const Camera camera(dims, 30 + 7.0 * view, 20);
    const auto begin = std::chrono::steady_clock::now();
    covered = Draw(scene, mesh, camera, &picture);
    times.push_back(MillisecondsSince(begin));
  }
  const double first = times.front();
  std::sort(times.begin() + 1, times.end());
  const double next = times.size() > 1 ? times[1 + (times.size() - 1) / 2] : 0;
  std::printf(
      "{\"build_ms\": %.1f, \"first_ms\": %.1f, \"next_ms\": %.1f, \"triangles\": %zu, "
      "\"covered_pixels\": %zu}\n",
      build, first, next, mesh.triangles.size(), covered);
  rtcReleaseScene(scene);
  rtcReleaseDevice(device);
}
