/* Calls entries of a library of kernels with captured blocks: stdin to stdout, see emulated.py. */
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

static void take(void *into, size_t bytes) {
    if (bytes && fread(into, 1, bytes, stdin) != bytes) exit(4);
}

int main(int count, char **arguments) {
    void *library = count == 2 ? dlopen(arguments[1], RTLD_NOW) : NULL;
    if (!library) {
        fprintf(stderr, "%s\n", count == 2 ? dlerror() : "a library was expected");
        return 1;
    }
    for (;;) {
        int64_t head[3]; /* bytes of the name, words, arrays */
        char name[128] = {0};
        if (fread(head, sizeof head, 1, stdin) != 1) return 0;
        if (head[0] >= (int64_t)sizeof name) return 2;
        int64_t *block = malloc(8 * head[1]);
        void **arrays = malloc(sizeof(void *) * head[2]);
        int64_t(*places)[2] = malloc(16 * head[2]);
        take(name, head[0]);
        take(block, 8 * head[1]);
        for (int64_t i = 0; i < head[2]; i++) {
            take(places[i], 16); /* its word, its bytes */
            arrays[i] = malloc(places[i][1] + 64);
            take(arrays[i], places[i][1]);
            block[places[i][0]] = (int64_t)(intptr_t)arrays[i];
        }
        int32_t (*entry)(void *) = (int32_t(*)(void *))dlsym(library, name);
        if (!entry || entry(block)) {
            fprintf(stderr, "%s failed\n", name);
            return 3;
        }
        fwrite(block, 8, head[1], stdout);
        for (int64_t i = 0; i < head[2]; i++) {
            fwrite(arrays[i], 1, places[i][1], stdout);
            free(arrays[i]);
        }
        free(block), free(arrays), free(places);
    }
}
