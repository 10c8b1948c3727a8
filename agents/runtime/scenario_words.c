/* Lists of allowed words, and the one that a mistyped word was meant to be. */
#include <stdlib.h>
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

/* Levenshtein's distance: single letters inserted, deleted or replaced. */
static int distance(const char *a, const char *b)
{
    int row[LONGEST_WORD + 1];
    int n = (int)strlen(b);
    if (n > LONGEST_WORD)
        return n;
    for (int j = 0; j <= n; j++)
        row[j] = j;
    for (int i = 1; a[i - 1] != '\0'; i++) {
        int diagonal = row[0];
        row[0] = i;
        for (int j = 1; j <= n; j++) {
            int replaced = diagonal + (a[i - 1] != b[j - 1]);
            diagonal = row[j];
            row[j] = least(replaced, 1 + least(row[j], row[j - 1]));
        }
    }
    return row[n];
}

const char *scenario_words_nearest(const struct scenario_words *words, const char *wrong)
{
    size_t length = strlen(wrong);
    int best = length < 3 ? 2 : 1 + (int)(length < 30 ? length : 30) / 3;
    const char *nearest = NULL;
    if (length == 0 || length > LONGEST_WORD)
        return NULL;
    for (int i = 0; i < words->count; i++) {
        int d = distance(wrong, words->word[i]);
        if (d < best) {
            best = d;
            nearest = words->word[i];
        }
    }
    return nearest;
}

void scenario_words_text(const struct scenario_words *words, const char *wrong, char *text,
                         size_t size)
{
    char hint[LONGEST_WORD + 24] = "";
    const char *nearest = scenario_words_nearest(words, wrong);
    if (nearest != NULL)
        snprintf(hint, sizeof hint, " (did you mean %s?)", nearest);
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
