/* Hand-written AVX2 warping: 16 lanes across examples, four rows in registers. The yardstick of
 * benchmarks/kernels.py:  gcc -O3 -mavx2 -mfma lanes.c -o lanes && ./lanes
 * Prints billions of cells for each CPU-second: float32, one dimension, length 64, absolute cost. */
#include <immintrin.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { LENGTH = 64, LANES = 16, QUERIES = 256, BLOCKS = 16, REPEATS = 9 };

static float queries[QUERIES][LENGTH];
static float examples[BLOCKS][LENGTH][LANES] __attribute__((aligned(64)));
static float above[LENGTH][LANES] __attribute__((aligned(64)));
static float result[QUERIES][BLOCKS][LANES] __attribute__((aligned(64)));

static inline __m256 cell(float x, __m256 e, __m256 up, __m256 left, __m256 corner) {
    const __m256 sign = _mm256_set1_ps(-0.0f);
    __m256 cost = _mm256_andnot_ps(sign, _mm256_sub_ps(_mm256_set1_ps(x), e));
    return _mm256_add_ps(cost, _mm256_min_ps(_mm256_min_ps(up, corner), left));
}

static void warp(const float *x, float (*block)[LANES], float *out) {
    const __m256 border = _mm256_set1_ps(1e32f);
    for (int j = 0; j < LENGTH; j++)
        for (int v = 0; v < LANES; v += 8) _mm256_store_ps(&above[j][v], border);
    for (int i = 0; i < LENGTH; i += 4) {
        __m256 left[4][2], corner[2];
        for (int v = 0; v < 2; v++) {
            corner[v] = i == 0 ? _mm256_setzero_ps() : border;
            for (int r = 0; r < 4; r++) left[r][v] = border;
        }
        for (int j = 0; j < LENGTH; j++)
            for (int v = 0; v < 2; v++) {
                __m256 e = _mm256_load_ps(&block[j][8 * v]), top = _mm256_load_ps(&above[j][8 * v]);
                __m256 a = cell(x[i], e, top, left[0][v], corner[v]);
                __m256 b = cell(x[i + 1], e, a, left[1][v], left[0][v]);
                __m256 c = cell(x[i + 2], e, b, left[2][v], left[1][v]);
                __m256 d = cell(x[i + 3], e, c, left[3][v], left[2][v]);
                corner[v] = top, left[0][v] = a, left[1][v] = b, left[2][v] = c, left[3][v] = d;
                _mm256_store_ps(&above[j][8 * v], d);
            }
    }
    for (int l = 0; l < LANES; l++) out[l] = above[LENGTH - 1][l];
}

static int ascending(const void *a, const void *b) {
    return (*(double *)a > *(double *)b) - (*(double *)a < *(double *)b);
}

int main(void) {
    double seconds[REPEATS], sum = 0;
    for (int q = 0; q < QUERIES; q++)
        for (int i = 0; i < LENGTH; i++) queries[q][i] = (float)rand() / RAND_MAX;
    for (float *e = &examples[0][0][0]; e < &examples[0][0][0] + sizeof examples / sizeof(float); e++)
        *e = (float)rand() / RAND_MAX;
    for (int repeat = 0; repeat < REPEATS; repeat++) {
        clock_t start = clock();
        for (int q = 0; q < QUERIES; q++)
            for (int b = 0; b < BLOCKS; b++) warp(queries[q], examples[b], result[q][b]);
        seconds[repeat] = (double)(clock() - start) / CLOCKS_PER_SEC;
        sum += result[repeat][0][0];
    }
    qsort(seconds, REPEATS, sizeof(double), ascending);
    double cells = (double)QUERIES * BLOCKS * LANES * LENGTH * LENGTH;
    printf("%.4f\n", cells / seconds[REPEATS / 2] / 1e9);
    fprintf(stderr, "checksum %f\n", sum);
    return 0;
}
