// Id-buffers by Embree 3 from C++: coherent packets of 16 rays, a block of 4 x 4 pixels each, or single rays.
//
//   embree16 FILE        FILE: what benches/bench.py's write_raw writes
//
// Then a line at a time on the standard input: "LANES THREADS [BITS]" draws every view, LANES being 16 or 1: ids and
// depths into one buffer a thread, then a row of bits for each view, as all others in the race do. The answer is the
// milliseconds a view took. BITS names a file for the rows.
#include <embree3/rtcore.h>
#include <xmmintrin.h>
#include <pmmintrin.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <limits>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

// Ray directions are at depth 1, so that a hit's distance is its depth.
struct Camera {
    float eye[3], first[3], right[3], down[3];
};

struct Header {
    uint32_t vertices, faces, cameras, width, height;
};

template <class T>
static void read(std::istream& in, T* to, size_t count) {
    if (!in.read(reinterpret_cast<char*>(to), std::streamsize(count * sizeof(T)))) {
        std::fprintf(stderr, "embree16: the file ends early\n");
        std::exit(1);
    }
}

static void packets(RTCScene scene, const Camera& c, uint32_t width, uint32_t height, uint32_t* ids, float* depths) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    for (uint32_t y0 = 0; y0 < height; y0 += 4) {
        for (uint32_t x0 = 0; x0 < width; x0 += 4) {
            alignas(64) int valid[16];
            alignas(64) RTCRayHit16 packet;
            // Loops over the lanes, which the compiler turns into wide registers.
            for (uint32_t k = 0; k < 16; ++k) {
                const uint32_t x = x0 + (k & 3), y = y0 + (k >> 2);
                const float fx = float(int(x)), fy = float(int(y));
                valid[k] = x < width && y < height ? -1 : 0;
                packet.ray.org_x[k] = c.eye[0];
                packet.ray.org_y[k] = c.eye[1];
                packet.ray.org_z[k] = c.eye[2];
                packet.ray.dir_x[k] = c.first[0] + fx * c.right[0] + fy * c.down[0];
                packet.ray.dir_y[k] = c.first[1] + fx * c.right[1] + fy * c.down[1];
                packet.ray.dir_z[k] = c.first[2] + fx * c.right[2] + fy * c.down[2];
                packet.ray.tnear[k] = 0;
                packet.ray.time[k] = 0;
                packet.ray.tfar[k] = std::numeric_limits<float>::infinity();
                packet.ray.mask[k] = ~0u;
                packet.ray.flags[k] = 0;
                packet.hit.geomID[k] = packet.hit.primID[k] = packet.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
            }
            rtcIntersect16(valid, scene, &context, &packet);
            const size_t across = std::min<size_t>(4, width - x0), along = std::min<size_t>(4, height - y0);
            for (size_t k = 0; k < along; ++k) {
                std::copy_n(packet.hit.primID + 4 * k, across, ids + (y0 + k) * width + x0);
                std::copy_n(packet.ray.tfar + 4 * k, across, depths + (y0 + k) * width + x0);
            }
        }
    }
}

static void singles(RTCScene scene, const Camera& c, uint32_t width, uint32_t height, uint32_t* ids, float* depths) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    constexpr uint32_t tile = 8;
    for (uint32_t y0 = 0; y0 < height; y0 += tile) {
        for (uint32_t x0 = 0; x0 < width; x0 += tile) {
            for (uint32_t y = y0; y < std::min(y0 + tile, height); ++y) {
                for (uint32_t x = x0; x < std::min(x0 + tile, width); ++x) {
                    const auto direction = [&](int axis) {
                        return c.first[axis] + float(x) * c.right[axis] + float(y) * c.down[axis];
                    };
                    RTCRayHit hit{};
                    hit.ray = {c.eye[0], c.eye[1], c.eye[2], 0, direction(0), direction(1), direction(2), 0,
                               std::numeric_limits<float>::infinity(), ~0u, 0, 0};
                    hit.hit.geomID = hit.hit.primID = RTC_INVALID_GEOMETRY_ID;
                    rtcIntersect1(scene, &context, &hit);
                    ids[size_t(y) * width + x] = hit.hit.primID;
                    depths[size_t(y) * width + x] = hit.ray.tfar;
                }
            }
        }
    }
}

int main(int count, char** arguments) {
    if (count != 2) {
        std::fprintf(stderr, "usage: embree16 FILE\n");
        return 2;
    }
    std::ifstream file(arguments[1], std::ios::binary);
    Header header{};
    read(file, &header, 1);
    // 512-bit registers, which Embree else leaves alone; the rest is its default.
    RTCDevice device = rtcNewDevice("frequency_level=simd512");
    RTCScene scene = rtcNewScene(device);
    RTCGeometry mesh = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    read(file, static_cast<float*>(rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12,
                                                           header.vertices)), 3 * size_t(header.vertices));
    read(file, static_cast<uint32_t*>(rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12,
                                                              header.faces)), 3 * size_t(header.faces));
    std::vector<Camera> cameras(header.cameras);
    read(file, cameras.data(), cameras.size());
    rtcCommitGeometry(mesh);
    rtcAttachGeometry(scene, mesh);
    rtcReleaseGeometry(mesh);
    rtcCommitScene(scene);
    std::printf("Embree %s, native packets of 16: %s\n", RTC_VERSION_STRING,
                rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) ? "yes" : "no");
    std::fflush(stdout);

    const size_t pixels = size_t(header.width) * header.height, words = (size_t(header.faces) + 63) / 64;
    std::string line;
    while (std::getline(std::cin, line)) {
        std::istringstream asked(line);
        unsigned lanes = 0, threads = 0;
        std::string path;
        asked >> lanes >> threads >> path;
        if ((lanes != 1 && lanes != 16) || threads == 0) {
            std::fprintf(stderr, "embree16: what is %s?\n", line.c_str());
            return 2;
        }
        const auto start = std::chrono::steady_clock::now();
        std::vector<uint64_t> rows(words * header.cameras);
        std::atomic<size_t> next{0};
        const auto work = [&] {
            // As Embree's manual asks.
            _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
            _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
            std::vector<uint32_t> ids(pixels);
            std::vector<float> depths(pixels);
            for (size_t view; (view = next++) < cameras.size();) {
                const auto draw = lanes == 16 ? packets : singles;
                draw(scene, cameras[view], header.width, header.height, ids.data(), depths.data());
                uint64_t* row = rows.data() + words * view;
                for (const uint32_t id : ids) {
                    if (id != RTC_INVALID_GEOMETRY_ID) row[id / 64] |= uint64_t(1) << id % 64;
                }
            }
        };
        std::vector<std::thread> others;
        for (unsigned k = 1; k < threads; ++k) others.emplace_back(work);
        work();
        for (auto& other : others) other.join();
        const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - start;
        if (!path.empty()) {
            std::ofstream(path, std::ios::binary)
                .write(reinterpret_cast<const char*>(rows.data()), std::streamsize(rows.size() * sizeof(uint64_t)));
        }
        std::printf("%.4f\n", took.count() / double(cameras.size()));
        std::fflush(stdout);
    }
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
}
