/* The parts of modelDescription.xml that a host needs: version, token, identifier, and the inputs and outputs: numbers and Booleans.
 *
 * This is not a full XML reader: it reads tags and attributes, which is enough for a well-formed file without comments inside
 * the variables.
 */
#ifndef INSENV_DESCRIPTION_H
#define INSENV_DESCRIPTION_H

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NAME = 160 };

typedef struct {
  char name[NAME];
  uint32_t reference;
  size_t size, rows, columns; /* elements; a scalar has no rows, a vector no columns */
  int is_boolean;
} Variable;

typedef struct {
  int version;
  char token[NAME], identifier[NAME];
  Variable *inputs, *outputs; /* first the numbers, then the Booleans, each in the order of the file */
  size_t input_count, output_count, input_elements, output_elements, boolean_inputs, boolean_outputs;
} Description;

/* The text of a file, terminated by a zero byte; NULL if it cannot be read. */
static char *read_file(const char *path) {
  FILE *file = fopen(path, "rb");
  size_t filled = 0, room = 1 << 16, got;
  char *text = malloc(room + 1);
  while (file && text && (got = fread(text + filled, 1, room - filled, file)) > 0)
    if ((filled += got) == room) text = realloc(text, (room *= 2) + 1);
  if (!file || !text) return NULL;
  fclose(file);
  text[filled] = 0;
  return text;
}

/* The next tag at or after *at: its text between '<' and '>'; *at moves behind it.  NULL at the end. */
static const char *next_tag(const char **at, size_t *length) {
  const char *begin = strchr(*at, '<'), *end;
  if (!begin) return NULL;
  char quote = 0;
  for (end = ++begin; *end && (quote || *end != '>'); end++)
    if (quote ? *end == quote : *end == '"' || *end == '\'') quote = quote ? 0 : *end;
  *length = (size_t)(end - begin);
  *at = end;
  return begin;
}

static int is_tag(const char *tag, const char *name) {
  const size_t n = strlen(name);
  return !strncmp(tag, name, n) && strchr(" \t\r\n/>", tag[n]);
}

/* The value of an attribute, truncated to NAME - 1 characters; empty if it is missing. */
static void attribute(const char *tag, size_t length, const char *name, char value[NAME]) {
  const size_t n = strlen(name);
  char quote = 0;
  value[0] = 0;
  for (const char *at = tag; at < tag + length; at++) {
    if (quote) {
      if (*at == quote) quote = 0;
    } else if (*at == '"' || *at == '\'')
      quote = *at;
    else if (!strncmp(at, name, n) && at[n] == '=' && strchr(" \t\r\n", at[-1])) {
      const char *begin = at + n + 2, *end = strchr(begin, at[n + 1]);
      size_t size = end ? (size_t)(end - begin) : 0;
      if (size >= NAME) size = NAME - 1;
      memcpy(value, begin, size);
      value[size] = 0;
      return;
    }
  }
}

/* Put the Booleans behind the numbers and return how many there are. */
static size_t booleans_last(Variable *list, size_t count) {
  Variable *kept = malloc((count + 1) * sizeof *kept);
  size_t filled = 0, booleans = 0;
  for (int boolean = 0; boolean < 2; boolean++)
    for (size_t i = 0; i < count; i++)
      if (list[i].is_boolean == boolean) kept[filled++] = list[i], booleans += (size_t)boolean;
  if (count) memcpy(list, kept, count * sizeof *kept);
  free(kept);
  return booleans;
}

static Description describe(const char *xml) {
  Description d;
  memset(&d, 0, sizeof d);
  Variable now, *kept = NULL; /* the variable whose children are read; `kept` points to its entry in the list */
  char value[NAME], causality[NAME] = "";
  const char *at = xml, *tag;
  size_t length;
  memset(&now, 0, sizeof now);
  while ((tag = next_tag(&at, &length))) {
    const int variable = is_tag(tag, "ScalarVariable"), real = is_tag(tag, "Real"), array = is_tag(tag, "Float64");
    const int boolean = is_tag(tag, "Boolean"), whole = array || (boolean && d.version == 3);
    if (is_tag(tag, "fmiModelDescription")) {
      attribute(tag, length, "fmiVersion", value);
      d.version = atoi(value);
      attribute(tag, length, d.version == 2 ? "guid" : "instantiationToken", d.token);
    } else if (is_tag(tag, "CoSimulation"))
      attribute(tag, length, "modelIdentifier", d.identifier);
    else if (is_tag(tag, "ModelStructure"))
      break;
    else if (is_tag(tag, "Dimension") && kept) {
      attribute(tag, length, "start", value);
      *(kept->rows ? &kept->columns : &kept->rows) = (size_t)strtoul(value, NULL, 10);
    }
    if (variable || whole) {
      memset(&now, 0, sizeof now);
      kept = NULL;
      attribute(tag, length, "name", now.name);
      attribute(tag, length, "causality", causality);
      attribute(tag, length, "valueReference", value);
      now.reference = (uint32_t)strtoul(value, NULL, 10);
    }
    if ((real || array || boolean) && now.name[0] && (!strcmp(causality, "input") || !strcmp(causality, "output"))) {
      Variable **list = causality[0] == 'i' ? &d.inputs : &d.outputs;
      size_t *count = causality[0] == 'i' ? &d.input_count : &d.output_count;
      *list = realloc(*list, (*count + 1) * sizeof **list);
      kept = &(*list)[(*count)++];
      *kept = now;
      kept->is_boolean = boolean;
      now.name[0] = 0;
    }
  }
  d.boolean_inputs = booleans_last(d.inputs, d.input_count);
  d.boolean_outputs = booleans_last(d.outputs, d.output_count);
  for (size_t i = 0; i < d.input_count + d.output_count; i++) {
    Variable *v = i < d.input_count ? &d.inputs[i] : &d.outputs[i - d.input_count];
    v->size = (v->rows ? v->rows : 1) * (v->columns ? v->columns : 1);
    *(i < d.input_count ? &d.input_elements : &d.output_elements) += v->size;
  }
  return d;
}

/* Name of an element: "name", "name[2]" or "name[1,2]", by rows. */
static void element_name(const Variable *v, size_t element, char *name, size_t room) {
  if (!v->rows)
    snprintf(name, room, "%s", v->name);
  else if (!v->columns)
    snprintf(name, room, "%s[%zu]", v->name, element + 1);
  else
    snprintf(name, room, "%s[%zu,%zu]", v->name, element / v->columns + 1, element % v->columns + 1);
}

#endif
