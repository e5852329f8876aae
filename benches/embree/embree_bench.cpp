// The peer of `render_bench`: the same scene through Embree, with 16-wide coherent packets.
//
// Usage: embree_bench TERRAIN.npy grid|tri [--images N] [--threads N] [--rays N] [--azimuth DEG] [--lambert]
//        [--pgm FILE]
// Scene: square cells of 5 m, first row in the north, flat datum; camera 10 km above it at the middle, looking down,
// 45 degrees, 512 x 512; Gaussian point spread of 0.6 px by sampling; one shadow ray to a point of the solar disc for every
// hit that faces the Sun (8 degrees high, azimuth clockwise from north). Every sample, from the look-up of its random
// offsets to the averaged pixel, is inside the measured time.
#include <embree3/rtcore.h>
#include <sys/resource.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

namespace {

constexpr float kCellM = 5.0f, kCameraM = 10000.0f, kPi = 3.14159265358979f;
constexpr int kSide = 512, kTile = 16, kLanes = 16;
constexpr float kPsfSigmaPx = 0.6f, kSunRadius = 0.004654f;
constexpr float kSunElevation = 8.0f * kPi / 180.0f;

[[noreturn]] void fail(const std::string& what) {
  std::fprintf(stderr, "embree_bench: %s\n", what.c_str());
  std::exit(1);
}

struct Terrain {
  int rows = 0, cols = 0;
  std::vector<float> heights;
};

Terrain read_npy(const char* path) {
  std::ifstream file(path, std::ios::binary);
  char magic[10];
  if (!file.read(magic, 10) || std::memcmp(magic, "\x93NUMPY", 6) != 0) fail(std::string(path) + " is not an .npy file");
  uint32_t length = uint8_t(magic[8]) | uint32_t(uint8_t(magic[9])) << 8;
  if (magic[6] > 1) {
    uint8_t more[2];
    file.read(reinterpret_cast<char*>(more), 2);
    length |= uint32_t(more[0]) << 16 | uint32_t(more[1]) << 24;
  }
  std::string header(length, ' ');
  file.read(header.data(), length);
  Terrain t;
  const size_t shape = header.find("'shape': (");
  if (header.find("'<f4'") == std::string::npos || header.find("True") != std::string::npos || shape == std::string::npos ||
      std::sscanf(header.c_str() + shape, "'shape': (%d, %d)", &t.rows, &t.cols) != 2)
    fail("expected a two-dimensional float32 array in C order, found " + header);
  t.heights.resize(size_t(t.rows) * t.cols);
  if (!file.read(reinterpret_cast<char*>(t.heights.data()), std::streamsize(t.heights.size() * 4))) fail("the array is cut off");
  return t;
}

RTCScene build(RTCDevice device, const Terrain& t, bool triangles) {
  RTCGeometry geometry = rtcNewGeometry(device, triangles ? RTC_GEOMETRY_TYPE_TRIANGLE : RTC_GEOMETRY_TYPE_GRID);
  auto* vertex = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                             3 * sizeof(float), t.heights.size()));
  for (int r = 0; r < t.rows; ++r)
    for (int c = 0; c < t.cols; ++c) {
      *vertex++ = (float(c) - 0.5f * float(t.cols - 1)) * kCellM;
      *vertex++ = (0.5f * float(t.rows - 1) - float(r)) * kCellM;
      *vertex++ = t.heights[size_t(r) * t.cols + c];
    }
  if (triangles) {
    const size_t cells = size_t(t.rows - 1) * (t.cols - 1);
    auto* index = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                 3 * sizeof(uint32_t), 2 * cells));
    for (int r = 0; r + 1 < t.rows; ++r)
      for (int c = 0; c + 1 < t.cols; ++c) {
        const uint32_t a = uint32_t(r) * t.cols + c, b = a + 1, d = a + t.cols, e = d + 1;
        for (uint32_t v : {a, d, b, b, d, e}) *index++ = v;
      }
  } else {
    auto* grid = static_cast<RTCGrid*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_GRID, 0, RTC_FORMAT_GRID, sizeof(RTCGrid), 1));
    *grid = {0, uint32_t(t.cols), uint16_t(t.cols), uint16_t(t.rows)};
  }
  rtcCommitGeometry(geometry);
  RTCScene scene = rtcNewScene(device);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene);
  return scene;
}

// Random offsets, made once: drawing them anew for each image would only slow this side down.
struct Offsets {
  static constexpr uint32_t kCount = 1u << 16;
  std::vector<float> psf_x, psf_y, sun_u, sun_v;
  Offsets() {
    uint64_t state = 0x9e3779b97f4a7c15ull;
    auto uniform = [&] {
      state += 0x9e3779b97f4a7c15ull;
      uint64_t z = state;
      z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9ull;
      z = (z ^ z >> 27) * 0x94d049bb133111ebull;
      return float(((z ^ z >> 31) >> 40) + 0.5) / 16777216.0f;
    };
    for (uint32_t i = 0; i < kCount + kLanes; ++i) {
      const float radius = kPsfSigmaPx * std::sqrt(-2.0f * std::log(uniform())), angle = 2.0f * kPi * uniform();
      const float disc = kSunRadius * std::sqrt(uniform()), turn = 2.0f * kPi * uniform();
      psf_x.push_back(radius * std::cos(angle));
      psf_y.push_back(radius * std::sin(angle));
      sun_u.push_back(disc * std::cos(turn));
      sun_v.push_back(disc * std::sin(turn));
    }
  }
};

uint32_t hash(uint32_t x) {
  x = (x ^ x >> 16) * 0x7feb352du;
  x = (x ^ x >> 15) * 0x846ca68bu;
  return x ^ x >> 16;
}

// Hapke 1963, w = h = 0.12, B0 = 1: the polynomials of `crates/render/src/brdf`, so that both sides shade alike.
inline float hapke1963(float mu0, float mu, float x) {
  const float w = 0.12f, h = 0.12f, two_gamma = 2.0f * std::sqrt(1.0f - w);
  const float sin_half = std::sqrt(x), cos_half = std::sqrt(1.0f - x);
  const float z = x < 0.5f ? x : 1.0f - x, root = x < 0.5f ? sin_half : cos_half;
  float p = 0.09813799f;
  for (float c : {-0.026445543f, 0.06186214f, 0.0727524f, 0.1667718f, 0.9999992f}) p = p * z + c;
  const float half_phase = x < 0.5f ? root * p : 0.5f * kPi - root * p;
  const float half_sin = sin_half * cos_half, cosine = 1.0f - 2.0f * x;
  const float phase = 1.6f * (half_sin + (0.5f * kPi - half_phase) * cosine) + 0.32f * kPi * x * x;
  const float num = h * std::max(cosine, 0.0f), den = 2.0f * half_sin;
  const bool large = num > 16.0f * den;
  const float quotient = (large ? den : num) / std::max(large ? num : den, 1.2e-38f);
  const float u = (large ? 16.0f : quotient) * 0.0625f;
  float slope = -0.0009145481f;
  for (float c : {0.007842377f, -0.041423157f, 0.16661125f, -0.49999535f, 0.99999994f}) slope = slope * u + c;
  float q = u * slope, ratio = slope * 0.0625f;
  for (int k = 0; k < 4; ++k) {
    const float grow = 2.0f - q;
    q *= grow;
    ratio *= grow;
  }
  const float surge = 1.0f - 0.5f * (large ? quotient : ratio) * (2.0f + q);
  const float den_h = (1.0f + two_gamma * mu0) * (1.0f + two_gamma * mu);
  const float num_h = (1.0f + 2.0f * mu0) * (1.0f + 2.0f * mu);
  return 0.25f * w * mu0 * (((1.0f + surge) * phase - 1.0f) * den_h + num_h) / (den_h * (mu0 + mu));
}

struct Counts {
  uint64_t primary = 0, hits = 0, shadow = 0, occluded = 0;
};

struct Renderer {
  RTCScene scene;
  Offsets offsets;
  int rays;
  float azimuth;
  bool lambert;
  std::vector<float> image = std::vector<float>(size_t(kSide) * kSide);

  void pixel(int px, int py, Counts& counts) {
    const float focal = 0.5f * kSide / std::tan(22.5f * kPi / 180.0f);
    const float se = std::sin(kSunElevation), ce = std::cos(kSunElevation);
    const float sx = ce * std::sin(azimuth), sy = ce * std::cos(azimuth);
    // Two directions square to the Sun's: horizontal, and up along the disc.
    const float ux = std::cos(azimuth), uy = -std::sin(azimuth);
    const float vx = -se * std::sin(azimuth), vy = -se * std::cos(azimuth), vz = ce;
    float sum = 0.0f;
    for (int first = 0; first < rays; first += kLanes) {
      const uint32_t at = hash(uint32_t(py * kSide + px) * 1024u + uint32_t(first)) % Offsets::kCount;
      alignas(64) RTCRayHit16 primary;
      alignas(64) int valid[kLanes];
      for (int k = 0; k < kLanes; ++k) {
        const float dx = (float(px) + 0.5f + offsets.psf_x[at + k] - 0.5f * kSide) / focal;
        const float dy = (0.5f * kSide - float(py) - 0.5f - offsets.psf_y[at + k]) / focal;
        const float inverse = 1.0f / std::sqrt(dx * dx + dy * dy + 1.0f);
        primary.ray.org_x[k] = primary.ray.org_y[k] = 0.0f;
        primary.ray.org_z[k] = kCameraM;
        primary.ray.dir_x[k] = dx * inverse;
        primary.ray.dir_y[k] = dy * inverse;
        primary.ray.dir_z[k] = -inverse;
        primary.ray.tnear[k] = primary.ray.time[k] = 0.0f;
        primary.ray.tfar[k] = 1e30f;
        primary.ray.mask[k] = ~0u;
        primary.ray.id[k] = primary.ray.flags[k] = 0;
        primary.hit.geomID[k] = primary.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
        valid[k] = first + k < rays ? -1 : 0;
      }
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
      rtcIntersect16(valid, scene, &context, &primary);

      alignas(64) RTCRay16 shadow;
      alignas(64) int facing[kLanes];
      alignas(64) float shade[kLanes];
      for (int k = 0; k < kLanes; ++k) {
        const float nx = primary.hit.Ng_x[k], ny = primary.hit.Ng_y[k], nz = primary.hit.Ng_z[k];
        const float scale = (nz < 0.0f ? -1.0f : 1.0f) / std::sqrt(nx * nx + ny * ny + nz * nz);
        const float u = offsets.sun_u[at + k], v = offsets.sun_v[at + k];
        const float lx = sx + u * ux + v * vx, ly = sy + u * uy + v * vy, lz = se + v * vz;
        const float one = 1.0f / std::sqrt(lx * lx + ly * ly + lz * lz);
        const float ex = -primary.ray.dir_x[k], ey = -primary.ray.dir_y[k], ez = -primary.ray.dir_z[k];
        const float mu0 = scale * one * (nx * lx + ny * ly + nz * lz), mu = scale * (nx * ex + ny * ey + nz * ez);
        const float hx = one * lx - ex, hy = one * ly - ey, hz = one * lz - ez;
        const bool lit = valid[k] && primary.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID && mu0 > 0.0f && mu > 0.0f;
        const float t = primary.ray.tfar[k];
        shadow.org_x[k] = primary.ray.dir_x[k] * t;
        shadow.org_y[k] = primary.ray.dir_y[k] * t;
        shadow.org_z[k] = kCameraM + primary.ray.dir_z[k] * t;
        shadow.dir_x[k] = one * lx;
        shadow.dir_y[k] = one * ly;
        shadow.dir_z[k] = one * lz;
        // A hit's position is known to a few millimetres in f32.
        shadow.tnear[k] = 0.05f;
        shadow.tfar[k] = 1e30f;
        shadow.time[k] = 0.0f;
        shadow.mask[k] = ~0u;
        shadow.id[k] = shadow.flags[k] = 0;
        facing[k] = lit ? -1 : 0;
        shade[k] = lambert ? mu0 : hapke1963(std::max(mu0, 1e-6f), std::max(mu, 1e-6f), 0.25f * (hx * hx + hy * hy + hz * hz));
      }
      rtcInitIntersectContext(&context);
      context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
      rtcOccluded16(facing, scene, &context, &shadow);
      for (int k = 0; k < kLanes; ++k) {
        const bool clear = shadow.tfar[k] > 0.0f;
        sum += facing[k] && clear ? shade[k] : 0.0f;
        counts.primary += valid[k] != 0;
        counts.hits += valid[k] && primary.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID;
        counts.shadow += facing[k] != 0;
        counts.occluded += facing[k] && !clear;
      }
    }
    image[size_t(py) * kSide + px] = sum / float(rays);
  }

  Counts draw(int num_threads) {
    std::atomic<int> next{0};
    std::vector<Counts> counts(num_threads);
    auto work = [&](int id) {
      // Local, so that the threads do not share a cache line.
      Counts own;
      constexpr int across = kSide / kTile;
      for (int tile = next++; tile < across * across; tile = next++)
        for (int i = 0; i < kTile * kTile; ++i)
          pixel(tile % across * kTile + i % kTile, tile / across * kTile + i / kTile, own);
      counts[id] = own;
    };
    std::vector<std::thread> threads;
    for (int id = 1; id < num_threads; ++id) threads.emplace_back(work, id);
    work(0);
    for (auto& thread : threads) thread.join();
    Counts total;
    for (const Counts& c : counts) {
      total.primary += c.primary;
      total.hits += c.hits;
      total.shadow += c.shadow;
      total.occluded += c.occluded;
    }
    return total;
  }
};

double cpu_seconds() {
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  auto seconds = [](const timeval& t) { return double(t.tv_sec) + 1e-6 * double(t.tv_usec); };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

double wall_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

bool memory_monitor(void* total, ssize_t bytes, bool) {
  *static_cast<std::atomic<ssize_t>*>(total) += bytes;
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) fail("usage: embree_bench TERRAIN.npy grid|tri [options]; they stand at the top of its source");
  const std::string kind = argv[2];
  if (kind != "grid" && kind != "tri") fail("expected grid or tri, found " + kind);
  int images = 3, threads = 2, rays = 64;
  float azimuth_deg = 30.0f;
  bool lambert = false;
  const char* pgm = nullptr;
  for (int i = 3; i < argc; ++i) {
    const std::string option = argv[i];
    if (option == "--lambert") {
      lambert = true;
    } else if (i + 1 >= argc) {
      fail("unknown option or missing value: " + option);
    } else if (option == "--images") {
      images = std::max(1, std::atoi(argv[++i]));
    } else if (option == "--threads") {
      threads = std::max(1, std::atoi(argv[++i]));
    } else if (option == "--rays") {
      rays = std::max(1, std::atoi(argv[++i]));
    } else if (option == "--azimuth") {
      azimuth_deg = float(std::atof(argv[++i]));
    } else if (option == "--pgm") {
      pgm = argv[++i];
    } else {
      fail("unknown option " + option);
    }
  }
  const Terrain terrain = read_npy(argv[1]);
  if (terrain.rows > 32767 || terrain.cols > 32767) fail("a grid has at most 32767 vertices a side");
  std::atomic<ssize_t> bytes{0};
  RTCDevice device = rtcNewDevice(("threads=" + std::to_string(threads)).c_str());
  rtcSetDeviceMemoryMonitorFunction(device, memory_monitor, &bytes);
  const double built_at = cpu_seconds();
  RTCScene scene = build(device, terrain, kind == "tri");
  if (rtcGetDeviceError(device) != RTC_ERROR_NONE) fail("Embree could not build the scene");
  const double build_s = cpu_seconds() - built_at;

  Renderer renderer{scene, Offsets(), rays, azimuth_deg * kPi / 180.0f, lambert};
  renderer.draw(threads);  // Warm the caches and the pages.
  std::vector<double> wall, cpu;
  Counts counts;
  for (int i = 0; i < images; ++i) {
    const double w = wall_seconds(), c = cpu_seconds();
    counts = renderer.draw(threads);
    wall.push_back(wall_seconds() - w);
    cpu.push_back((cpu_seconds() - c) / threads);
  }
  double mean = 0.0;
  for (float value : renderer.image) mean += value;
  mean /= double(renderer.image.size());
  std::printf("embree %s wall_s=%.4f cpu_s=%.4f mean=%.6f primary=%llu missed=%llu shadow=%llu occluded=%.4f build_cpu_s=%.1f memory_mb=%.0f\n",
              kind.c_str(), median(wall), median(cpu), mean, (unsigned long long)counts.primary,
              (unsigned long long)(counts.primary - counts.hits), (unsigned long long)counts.shadow,
              double(counts.occluded) / double(counts.shadow), build_s, double(bytes) / 1e6);
  if (pgm) {
    std::ofstream out(pgm, std::ios::binary);
    out << "P5\n" << kSide << " " << kSide << "\n255\n";
    const float top = *std::max_element(renderer.image.begin(), renderer.image.end());
    for (float value : renderer.image) out.put(char(uint8_t(255.0f * value / top)));
  }
  rtcReleaseScene(scene);
  rtcReleaseDevice(device);
}
