/* Formatting without the C library's. */
#include "report.h"

#include <string.h>

#include "platform.h"

#define LINE 96

struct line {
    char text[LINE];
    int length;
};

static int failures;

static void put(struct line *line, char c)
{
    if (line->length < LINE - 2)
        line->text[line->length++] = c;
}

static void put_text(struct line *line, const char *text)
{
    while (*text)
        put(line, *text++);
}

static void put_int(struct line *line, int value)
{
    char digits[12];
    int count = 0;
    unsigned rest = value < 0 ? 0u - (unsigned)value : (unsigned)value;
    do {
        digits[count++] = (char)('0' + rest % 10u);
        rest /= 10u;
    } while (rest);
    if (value < 0)
        put(line, '-');
    while (count)
        put(line, digits[--count]);
}

static void put_hexadecimal(struct line *line, uint64_t bits)
{
    for (int shift = 60; shift >= 0; shift -= 4)
        put(line, "0123456789abcdef"[(bits >> shift) & 0xFu]);
}

static uint64_t bits_of(dse_real value)
{
    double wide = (double)value;
    uint64_t bits;
    memcpy(&bits, &wide, sizeof bits);
    return bits;
}

static void put_real(struct line *line, dse_real value)
{
    if (value != value)
        put_text(line, "nan");
    else
        put_hexadecimal(line, bits_of(value));
}

static void end(struct line *line)
{
    line->text[line->length++] = '\n';
    line->text[line->length] = '\0';
    platform_write(line->text);
}

static struct line begin(const char *name)
{
    struct line line = {.length = 0};
    put_text(&line, name);
    return line;
}

void report_bits(const char *name, uint64_t bits)
{
    struct line line = begin(name);
    put(&line, ' ');
    put_hexadecimal(&line, bits);
    end(&line);
}

void report_real(const char *name, dse_real value)
{
    struct line line = begin(name);
    put(&line, ' ');
    put_real(&line, value);
    end(&line);
}

void report_vector(const char *name, int n, const dse_real *x)
{
    for (int i = 0; i < n; i++) {
        struct line line = begin(name);
        put(&line, '[');
        put_int(&line, i);
        put_text(&line, "] ");
        put_real(&line, x[i]);
        end(&line);
    }
}

void report_digest(const char *name, int n, const dse_real *x)
{
    uint64_t hash = 0xcbf29ce484222325u;
    for (int i = 0; i < n; i++) {
        uint64_t bits = x[i] != x[i] ? 0x7ff8000000000000u : bits_of(x[i]);
        for (int byte = 0; byte < 8; byte++) {
            hash ^= (bits >> 8 * byte) & 0xFFu;
            hash *= 0x100000001b3u;
        }
    }
    report_bits(name, hash);
}

void report_int(const char *name, int value)
{
    struct line line = begin(name);
    put(&line, ' ');
    put_int(&line, value);
    end(&line);
}

void report_check(const char *name, int holds)
{
    if (holds)
        return;
    failures++;
    struct line line = begin("FAILED ");
    put_text(&line, name);
    end(&line);
}

int report_verdict(void)
{
    report_int("failures", failures);
    return failures ? 1 : 0;
}
