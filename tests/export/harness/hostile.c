#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "model.h"

#include "interface.h"
static double drawn(uint64_t *seed)
{
    static const double strange[] = {0.0, -0.0, 1e-310, 1e308, -1e308, NAN, INFINITY, -INFINITY, 1e-9, -1.0};
    *seed = *seed * 6364136223846793005ULL + 1442695040888963407ULL;
    if ((*seed >> 60) < 4) {
        return strange[(*seed >> 33) % 10];
    }
    return ((double)(*seed >> 11) / 9007199254740992.0 - 0.5) * ((*seed >> 59) & 1 ? 2.0 : 2e3);
}

static void *hurt(void *given)
{
    uint64_t seed = *(uint64_t *)given;
    void *own = made(TOKEN), *kept = NULL, *read = NULL;
    double value, time = 0.0, by[2] = {1.0, NAN};
    unsigned known[2], output;
    size_t size = 0;
    byte *bytes;
    int k, done = 0;
    if (own == NULL || made("{another}") != NULL) {
        abort();
    }
    begun(own);
    GET_STATE(own, &kept);
    STATE_SIZE(own, kept, &size);
    bytes = malloc(size);
    for (k = 0; k < 10000; k++) {
        unsigned reference = (unsigned)(seed >> 40) % 8000, input = 1000 + (unsigned)k % 2;
        output = 2000 + (unsigned)k % 5;
        value = drawn(&seed);
        set(own, input, &value);
        value = drawn(&seed);
        set(own, reference, &value);
        done += stepped(own, &time, k % 3 ? 0.01 : drawn(&seed) * 1e-3) == 0;
        get(own, reference, &value);
        get(own, output, &value);
        known[0] = reference;
        known[1] = 1000;
        sloped(own, output, known, by, &value);
        if (k % 7 == 0) {
            TO_BYTES(own, kept, bytes, size);
            FROM_BYTES(own, bytes, size, &read);
            SET_STATE(own, read);
        }
    }
    free(bytes);
    FREE_STATE(own, &kept);
    FREE_STATE(own, &read);
    FREE(own);
    *(uint64_t *)given = (uint64_t)done;
    return NULL;
}

int main(void)
{
    uint64_t seeds[2] = {1, 1};
    pthread_t threads[2];
    pthread_create(&threads[0], NULL, hurt, &seeds[0]);
    pthread_create(&threads[1], NULL, hurt, &seeds[1]);
    pthread_join(threads[0], NULL);
    pthread_join(threads[1], NULL);
    printf("%d\n", (int)seeds[0]);
    return seeds[0] == seeds[1] && seeds[0] > 1000 ? 0 : 1;
}
