/* Lists of allowed words, and the one that a mistyped word was meant to be. */
#include <string.h>

#include "runtime/scenario_internal.h"

#define LONGEST_WORD 63

void scenario_words_add(struct scenario_words *words, const char *word)
{
    if (words->count < SCENARIO_MAX_WORDS)
        words->word[words->count++] = word;
}

static int least(int a, int b)
{
    return a < b ? a : b;
}

/* Letters inserted, deleted, replaced or swapped with their neighbour to make b of a (optimal
 * string alignment): row[i % 3][j] is the distance of the first i letters of a to the first j of b.
 */
static int distance(const char *a, const char *b)
{
    int row[3][LONGEST_WORD + 1];
    int m = (int)strlen(a), n = (int)strlen(b);
    if (n > LONGEST_WORD)
        return n;
    for (int j = 0; j <= n; j++)
        row[0][j] = j;
    for (int i = 1; i <= m; i++) {
        int *now = row[i % 3];
        const int *before = row[(i + 2) % 3], *earlier = row[(i + 1) % 3];
        now[0] = i;
        for (int j = 1; j <= n; j++) {
            now[j] =
                least(before[j - 1] + (a[i - 1] != b[j - 1]), 1 + least(before[j], now[j - 1]));
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
                now[j] = least(now[j], earlier[j - 2] + 1);
        }
    }
    return row[m % 3][n];
}

int scenario_words_nearest(const struct scenario_words *words, const char *wrong)
{
    size_t length = strlen(wrong);
    int best = length < 3 ? 2 : 1 + (int)(length < 30 ? length : 30) / 3;
    int nearest = -1;
    if (length == 0 || length > LONGEST_WORD)
        return -1;
    for (int i = 0; i < words->count; i++) {
        int d = distance(wrong, words->word[i]);
        if (d < best) {
            best = d;
            nearest = i;
        }
    }
    return nearest;
}

void scenario_words_text(const struct scenario_words *words, const char *wrong, char *text,
                         size_t size)
{
    char hint[LONGEST_WORD + 24] = "";
    int nearest = scenario_words_nearest(words, wrong);
    if (nearest >= 0)
        snprintf(hint, sizeof hint, " (did you mean %s?)", words->word[nearest]);
    size_t room = size - strlen(hint) - sizeof ", ..";
    size_t n = (size_t)snprintf(text, size, "%s", words->count == 0 ? "none" : "");
    for (int i = 0; i < words->count; i++) {
        if (n + strlen(words->word[i]) + 2 > room) {
            n += (size_t)snprintf(text + n, size - n, ", ..");
            break;
        }
        n += (size_t)snprintf(text + n, size - n, "%s%s", i > 0 ? ", " : "", words->word[i]);
    }
    snprintf(text + n, size - n, "%s", hint);
}
